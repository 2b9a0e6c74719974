"""Results of the library on several processes equal those on one process."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Direct,
    Iterative,
    Material,
    NotConverged,
    PetrovGalerkinProblem,
    Reduction,
    Sibling,
    SingularSystem,
    Spaces,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    buckling,
    force_transfer,
    forces_along,
    lumped_mass,
    nodal_flux,
    prescribe,
    reactions,
    solve,
    split,
    vibration_modes,
)
from pw_elements.algebra import symmetric_part
from pw_elements.contact import ContactPair, Plane, Sphere, solve_contact, solve_impact
from pw_elements.contact.system import preconditioners
from pw_elements.elasticity import StressState, nodal_load
from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from pw_elements.solvers import automatic
from study.benchmarks.v15_incompressible.fields import (
    largest_displacement_error_of_two_layers,
    make_distorted_two_layer_mesh,
)
from study.meshes.distortion import distort_unit_domain_smoothly
from study.model.discretisation import discretise, reduction_for_mass_condensation
from tests.contact.cases import (
    GALERKIN,
    PETROV_GALERKIN,
    ElasticBody,
    make_finite_strain_unknown_and_residual,
    on_plane,
)
from tests.contact.iterative import (
    STACKED_CASE_MAKERS_BY_NAME,
    SolidBlock,
    nearly_sliding_contact_arguments,
)
from tests.contact.two_bodies import StackedBlocks
from tests.parallel import assert_same_on_processes


def make_box_mesh(comm, size=(1, 1, 2), divisions=(3, 3, 5), cell_name="tetrahedron"):
    return create_box(comm, [(0, 0, 0), size], divisions, CellType[cell_name])


def make_lower_end_supports(body, axis, displacements=(0.0, 0.0, 0.0)):
    """Create supports with the given displacements at the lower end of a body along an axis."""
    return body.make_supports(
        *((i, on_plane(axis, 0.0), displacements[i]) for i in range(body.dim))
    )


def displacement_and_pressure_norms(hybrid_space, solution):
    """Return the norms of the displacement and of the pressure in the solution of a hybrid body."""
    fields = zip(("displacement", "pressure"), split(hybrid_space, solution), strict=True)
    return {field: function.x.petsc_vec.norm() for field, function in fields}


# -- linear problems -------------------------------------------------------------------------------


def compute_beam_numbers(comm, method):
    mesh = triangles(comm, (0.0, -0.5), (8.0, 0.5), (16, 4), "crossed")
    body = ElasticBody(mesh, method, "plane stress", 2.0)
    U, K, M, supports = body.space, body.K, body.M, make_lower_end_supports(body, 0, (0.0, 0.01))
    f = body.traction_load((-1.0, 0.0), on_plane(0, 8.0))
    f.axpy(1.0, nodal_load(U, lambda x: on_plane(0, 8.0)(x) & on_plane(1, 0.0)(x), (0, 1e-3)))
    a = solve(K, f, supports)
    nodes = fem.locate_dofs_geometrical(U, on_plane(0, 0.0))
    vectors = Reduction.dirichlet(U, [fem.dirichletbc(np.array([0.0, 0.01]), nodes, U)])
    stresses = {form: body.initial_stress_matrix(f, supports, form) for form in ("G", "J")}
    free = vibration_modes(K, M, body.make_supports(), 4)
    parts = symmetric_part(K), symmetric_part(stresses["J"])
    return {
        "displacement norm": a.norm(),
        "held as vectors": solve(K, f, vectors).norm(),
        "reactions": forces_along(U, reactions(K, a, f), on_plane(0, 0.0)).force,
        "stiffness norm": K.norm(),
        "mass norm": M.norm(),
        "rigid": free.n_rigid,
        "free frequencies": free.eigenvalues[3:],
        "symmetrised": buckling(*parts, supports, 1, symmetrised=True).factors,
        **{f"buckling {form}": buckling(K, S, supports, 2).factors for form, S in stresses.items()},
        **{
            f"frequencies {symmetrised}": vibration_modes(
                K, M, supports, 3, symmetrised
            ).eigenvalues
            for symmetrised in (False, True)
        },
    }


def assert_parallel_identities(comm):
    """Assert two identities that hold on any number of processes, and return an empty dictionary.

    The stiffness of the new element is the force transfer matrix T times the standard stiffness.
    The solution of a body in two layers with separate pressures is exact.
    """
    mesh = move_nodes(triangles(comm, (0.0, 0.0), (1.0, 1.0), (7, 6)), distort_unit_domain_smoothly)
    galerkin, pw = (
        ElasticBody(mesh, method, "plane stress") for method in (GALERKIN, PETROV_GALERKIN)
    )
    shared = force_transfer(galerkin.space).matMult(galerkin.K)
    assert (shared - pw.K).norm() < 1e-14 * pw.K.norm()
    for cell in (CellType.triangle, CellType.tetrahedron):
        assert (
            largest_displacement_error_of_two_layers(
                Spaces.hybrid, make_distorted_two_layer_mesh(comm, cell), has_pressure_jump=True
            )
            < 1e-12
        )
    return {}


def compute_condensed_element_numbers(comm, element_name):
    def make_distorted_mesh(cell):
        make = quadrilaterals if cell == "quadrilateral" else triangles
        return move_nodes(make(comm, (0.0, 0.0), (1.0, 1.0), (7, 5)), distort_unit_domain_smoothly)

    body = discretise(
        element_name, make_distorted_mesh, Material(1.0, 0.3), StressState.PLANE_STRESS
    )
    U, K = body.space, body.K
    f = assemble_vector(body.body.body_load((0.3, -1.0)))
    supports = body.supports([prescribe(U, i, on_plane(0, 0.0), 0.01 * i) for i in range(2)])
    a = solve(K, f, supports)
    wall = ContactPair(on_plane(0, 0.0), Plane((0.0, 0.0), (1.0, 0.0)), 0.4)
    pushed = assemble_vector(body.body.body_load((-0.1, -0.035)))
    (state,) = solve_contact(K, pushed, body.supports([]), [wall], U)
    M = assemble_matrix(body.body.mass())
    numbers = {
        f"guyan {left}": vibration_modes(
            K, M, reduction_for_mass_condensation(supports, left), 3
        ).eigenvalues
        for left in ("transposed", "same")
    }
    if element_name == "pw-Q8":
        lumped = vibration_modes(K, lumped_mass(M, U), supports, 3)
        numbers["lumped"] = lumped.eigenvalues
    return numbers | {
        "displacement norm": a.norm(),
        "stiffness norm": supports.matrix(K).norm(),
        "reactions": forces_along(U, reactions(K, a, f), on_plane(0, 0.0)).force,
        "contact": state.pairs[0].force_normal,
        "contact displacement norm": state.displacement.norm(),
    }


def compute_rubber_numbers(comm):
    mesh = make_box_mesh(comm, (1, 1, 1), (3, 3, 3))
    spaces = Spaces.petrov_galerkin(mesh)
    U, (u, residual) = (
        spaces.trial,
        make_finite_strain_unknown_and_residual(spaces, quadrature_degree=3),
    )
    depth = fem.Constant(mesh, -0.3)
    conditions = [prescribe(U, i, on_plane(2, 0.0)) for i in range(3)]
    conditions.append(prescribe(U, 2, on_plane(2, 1.0), depth))
    problem = PetrovGalerkinProblem(residual, u, conditions)
    problem.solve(depth, increments=2)
    return {
        "reactions": problem.reactions().norm(),
        "tractions": nodal_flux(spaces, problem.reactions(), on_plane(2, 0.0)).flux,
        "volume": assemble_scalar(ufl.det(ufl.Identity(3) + ufl.grad(u)) * ufl.dx),
        "iterations": [len(part.relative_corrections) for part in problem.increments],
    }


def compute_hybrid_body_numbers(comm, state):
    square = triangles(comm, (0.0, 0.0), (1.0, 1.0), (7, 6))
    mesh = (
        make_box_mesh(comm)
        if state == "solid"
        else move_nodes(square, distort_unit_domain_smoothly)
    )
    body = ElasticBody(mesh, Spaces.hybrid, state, 2e9, 0.5)
    f = body.body_force_load([3e6] * body.dim)
    f.axpy(1.0, nodal_load(body.space, on_plane(0, 0.0), [2e6] * body.dim))
    a = solve(body.K, f, make_lower_end_supports(body, 0, (0.0, 0.01, 0.02)))
    return displacement_and_pressure_norms(body.space, a) | {
        "reactions": reactions(body.K, a, f).norm()
    }


def compute_impact_numbers(comm):
    body = ElasticBody(make_box_mesh(comm, (2, 1, 1), (6, 3, 3)), GALERKIN, "solid", 10.0)
    U = body.space
    sibling = Sibling.from_space(U)
    K, M = sibling.matrix(body.K), lumped_mass(sibling.matrix(body.M), U)
    weight = sibling.load(body.body_force_load((0.0, 0.0, -0.5)))
    thrown = K.createVecRight()
    thrown.array.reshape(-1, 3)[:] = (0.5, 0.1, -1.0)
    floor = ContactPair(on_plane(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
    ball = ContactPair(on_plane(2, 1.0), Sphere((1, 0.5, 4), 2.9), 0.2)
    history = solve_impact(
        K, M, sibling.dirichlet([]), [floor, ball], U, 1.5, thrown,
        load=lambda time: weight * (1 + time),
        paths=[None, lambda time: (0.2 * time, 0.0, -0.4 * time)],
        step=0.025, frames=2,
    )  # fmt: skip
    cut = comm.allgather(np.any(on_plane(2, 0.0)(U.tabulate_dof_coordinates().T)))
    assert comm.size == 1 or sum(cut) > 1, "the partition spares the contact"
    fields = ("force_normal", "force_tangential", "status", "gap", "slip", "displacement")
    # the sibling at rest: supports with values, contact on its gaps
    supports = sibling.dirichlet([prescribe(U, i, on_plane(2, 0.0), 0.02 * i) for i in range(3)])
    near = ContactPair(on_plane(2, 1.0), Sphere((1, 0.5, 3.91), 2.9), 0.2)
    (state,) = solve_contact(K, weight, supports, near, U)
    return {
        "critical step": history.critical_step,
        "energy": list(vars(history.energies).values()),
        "displacement": history.displacement.norm(),
        "velocity": history.velocity.norm(),
        **{f"force {k}": pair.force for k, pair in enumerate(history.pairs)},
        **{
            f"frame {n} {k} {field}": getattr(pair, field)
            for n, frame in enumerate(history.frames)
            for k, pair in enumerate(frame.pairs)
            for field in fields
        },
        "held": sibling.displacement(solve(K, weight, supports)).norm(),
        "static force": state.pairs[0].force_normal,
        "static gap": state.pairs[0].gap,
    }


def compute_numbers_of_solid_by_corrected_factors(comm):
    """Return the results and the cost of a solid block whose first factors serve all systems."""
    arguments = SolidBlock(n=3, comm=comm).contact_arguments_of_case("rough floor")
    (state,) = states = solve_contact(*arguments, solver=Direct())
    return {
        "systems": state.iterations,
        "factorisations": state.report.factorisations,
        "solutions for corrections": state.report.krylov_iterations,
        "unique": int(state.unique),
        **sum_contact_states(states),
    }


# -- the iterative solver --------------------------------------------------------------------------


def compute_iterative_clamped_body_numbers(comm, cell):
    body = ElasticBody(
        make_box_mesh(comm, (2, 1, 1), (4, 2, 2), cell), PETROV_GALERKIN, "solid", 1.0
    )
    f, supports = (
        body.body_force_load((0.0, 0.3, -1.0)),
        make_lower_end_supports(body, 0, (0.0, 0.1, 0.2)),
    )
    with pytest.raises(SingularSystem):
        solve(
            body.K, f, body.make_supports((0, on_plane(0, 0.0)), (1, on_plane(0, 0.0))), Iterative()
        )
    modes = vibration_modes(body.K, body.M, supports, 3, solver=Iterative())
    displacement = solve(body.K, f, supports, Iterative())
    return {"displacement norm": displacement.norm(), "frequencies": modes.eigenvalues}


def compute_iterative_incompressible_numbers(comm, cell):
    body = ElasticBody(
        make_box_mesh(comm, (2, 1, 1), (4, 2, 2), cell), Spaces.hybrid, "solid", 2e9, 0.5
    )
    f, supports = (
        body.body_force_load((0.0, 3e8, -1e9)),
        make_lower_end_supports(body, 0, (0.0, 0.1, 0.2)),
    )
    return displacement_and_pressure_norms(body.space, solve(body.K, f, supports, Iterative()))


def sum_contact_states(states):
    """Return norms, sums and counts of contact states, independent of the order of nodes."""
    sums = {}
    for k, state in enumerate(states):
        sums[f"{k} displacement norm"] = state.displacement.norm()
        for number, pair in enumerate(state.pairs):
            sums[f"{k} {number} statuses"] = np.bincount(pair.status, minlength=3)
            sums[f"{k} {number} force"] = pair.force
            sums[f"{k} {number} normal"] = pair.force_normal
    return sums


def compute_block_matrix_numbers(comm):
    solid = SolidBlock(n=3, comm=comm)
    solid.K = assemble_matrix(solid.body.stiffness(), blocked=True)
    (state,) = solve_contact(*solid.contact_arguments_of_case("rough floor"), solver=Iterative())
    return {
        "contact": state.displacement.norm(),
        "of K": solve(
            solid.K,
            solid.press_and_push_load(),
            solid.base_supports_moved_by_1_2_3_times(),
            Iterative(),
        ).norm(),
        "users of K": solid.K.getRefCount(),  # solvers no longer hold a reference to it
    }


def compute_auto_fallback_numbers(comm):
    """Return the results of "auto", where Krylov's method fails in the second increment.

    It fails because the preconditioner is prevented from fixing nodes.
    """
    arguments = nearly_sliding_contact_arguments(SolidBlock(n=2, comm=comm))
    with pytest.MonkeyPatch.context() as patch:
        for limit in ("_MIN_KRYLOV_DOFS", "_MIN_KRYLOV_DOFS_IF_HELD_BY_CONTACT"):
            patch.setattr(automatic, limit, 1)
        patch.setattr(preconditioners, "_MIN_STICKING_NODES_WITHOUT_ANCHORS", 0)
        states = solve_contact(*arguments)
        patch.setattr(automatic, "total_free_memory_in_bytes", lambda _: 1e6)
        with pytest.raises(NotConverged) as caught:
            solve_contact(*arguments)
    assert len(set(comm.allgather(str(caught.value)))) == 1
    return {
        "factorisations": [state.report.factorisations for state in states],
        **sum_contact_states(states),
    }


# -- all of them -----------------------------------------------------------------------------------


def prefix_numbers_with_case_names(numbers_by_case):
    return {
        f"{case} {key}": n
        for case, numbers in numbers_by_case.items()
        for key, n in numbers.items()
    }


def compute_all_direct_numbers(comm):
    return prefix_numbers_with_case_names(
        {
            "galerkin": compute_beam_numbers(comm, GALERKIN),
            "pw": compute_beam_numbers(comm, PETROV_GALERKIN),
        }
        | {"identity": assert_parallel_identities(comm)}
        | {name: compute_condensed_element_numbers(comm, name) for name in ("pw-Q8", "pw-Q9")}
        | {"rubber": compute_rubber_numbers(comm), "impact": compute_impact_numbers(comm)}
        | {"corrected factors": compute_numbers_of_solid_by_corrected_factors(comm)}
        | {
            f"hybrid {state}": compute_hybrid_body_numbers(comm, state)
            for state in ("axisymmetric", "solid")
        }
    )


SINGLE_BODY_CASES = ("corner", "tilted", "sphere by forces", "plate by forces")


def compute_all_iterative_numbers(comm):
    def solve_and_sum_contact_states(arguments):
        return sum_contact_states(solve_contact(*arguments, solver=Iterative()))

    def compute_stacked_block_numbers(case, **body):
        """Return the results of stacked blocks whose upper block is the slave."""
        stack = StackedBlocks((3, 2), "tetrahedron", upper_range=(0.13, 0.83), comm=comm, **body)
        return solve_and_sum_contact_states(STACKED_CASE_MAKERS_BY_NAME[case](stack, "upper"))

    rubber = SolidBlock(method=Spaces.hybrid, n=2, comm=comm, nu=0.5)
    return prefix_numbers_with_case_names(
        {
            cell: compute_iterative_clamped_body_numbers(comm, cell)
            for cell in ("tetrahedron", "hexahedron")
        }
        | {
            f"hybrid {cell}": compute_iterative_incompressible_numbers(comm, cell)
            for cell in ("tetrahedron", "hexahedron")
        }
        | {
            case: solve_and_sum_contact_states(
                SolidBlock(n=2, comm=comm).contact_arguments_of_case(case)
            )
            for case in SINGLE_BODY_CASES
        }
        | {
            "hybrid sphere": solve_and_sum_contact_states(
                rubber.contact_arguments_of_case("sphere")
            )
        }
        | {
            case: compute_stacked_block_numbers(case, modulus_ratio=0.5)
            for case in ("on a floor", "forces through contact")
        }
        | {
            "hybrid stacked": compute_stacked_block_numbers(
                "held by contact", element="hybrid", nu=0.5
            )
        }
        | {
            "sliding": solve_and_sum_contact_states(
                nearly_sliding_contact_arguments(SolidBlock(n=2, comm=comm))
            )
        }
        | {
            "blocked": compute_block_matrix_numbers(comm),
            "auto": compute_auto_fallback_numbers(comm),
        }
    )


@pytest.mark.parametrize(
    ("numbers", "rel"), [(compute_all_direct_numbers, 1e-10), (compute_all_iterative_numbers, 1e-8)]
)
def test_same_numbers_on_several_processes(numbers, rel, request):
    processes = 3 if request.config.getoption("--nightly") else 2
    assert_same_on_processes(numbers, process_counts=[processes], rel=rel)
