"""Reader of VTX files that uses ADIOS2's C library, independent of DOLFINx and this package."""

import ctypes
from pathlib import Path

import numpy as np

# enumerators of adios2_c_types.h
ADIOS2_STEP_MODE_READ, ADIOS2_MODE_READ, ADIOS2_MODE_SYNC, ADIOS2_STEP_STATUS_END_OF_STREAM = (
    2,
    2,
    5,
    2,
)
VTX_FIELD_NAMES = (
    "geometry connectivity displacement contact_force gap slip status pressure tributary_pressure "
    "traction true_pressure"
)
ADIOS2_FUNCTIONS_RETURNING_POINTERS = (
    "init_serial",
    "declare_io",
    "open",
    "inquire_variable",
    "inquire_attribute",
)


def load_adios2_library():
    """Load ADIOS2's C library from the folder of the one that DOLFINx uses; None if missing."""
    import dolfinx  # noqa: F401

    maps = Path("/proc/self/maps")
    loaded = {line.split()[-1] for line in maps.read_text().splitlines() if "adios2" in line}
    for folder in {Path(name).parent for name in loaded}:
        for path in sorted(folder.glob("libadios2*_c.so*")):
            shared_library = ctypes.CDLL(str(path))
            for name in ADIOS2_FUNCTIONS_RETURNING_POINTERS:
                getattr(shared_library, f"adios2_{name}").restype = ctypes.c_void_p
            shared_library.adios2_inquire_blockinfo.restype = ctypes.POINTER(ctypes.c_size_t)
            return shared_library
    return None


def iterate_adios2_steps(path):
    """Yield, for each step of a file, ADIOS2's library, the IO object and the open engine.

    The IO object gives access to the variables and attributes, the engine to their values.
    """
    adios = load_adios2_library()
    handle = ctypes.c_void_p(adios.adios2_init_serial())
    io = ctypes.c_void_p(adios.adios2_declare_io(handle, b"reader"))
    engine = ctypes.c_void_p(adios.adios2_open(io, str(path).encode(), ADIOS2_MODE_READ))
    assert engine, f"{path} cannot be opened"
    status = ctypes.c_int()
    while True:
        adios.adios2_begin_step(
            engine, ADIOS2_STEP_MODE_READ, ctypes.c_float(-1), ctypes.byref(status)
        )
        if status.value != 0:
            assert status.value == ADIOS2_STEP_STATUS_END_OF_STREAM
            break
        yield adios, io, engine
        adios.adios2_end_step(engine)
    adios.adios2_close(engine)
    adios.adios2_finalize(handle)


def read_times_and_fields(path):
    """Return the time and the fields (points, components) of each step.

    The blocks of all processes that wrote the file are joined.
    """
    steps = []
    for adios, io, engine in iterate_adios2_steps(path):
        values = {}
        for name in VTX_FIELD_NAMES.split():
            variable = ctypes.c_void_p(adios.adios2_inquire_variable(io, name.encode()))
            if variable:
                kind = np.int64 if name == "connectivity" else np.float64
                values[name] = read_blocks_of_all_writers(adios, engine, variable, len(steps), kind)
        time = np.empty(1)
        variable = ctypes.c_void_p(adios.adios2_inquire_variable(io, b"step"))
        assert adios.adios2_get(engine, variable, as_c_pointer(time), ADIOS2_MODE_SYNC) == 0
        steps.append((time[0], values))
    return steps


def read_vtk_schema(path):
    """Return the XML text in the file that tells ParaView how to read it."""
    text, size = ctypes.create_string_buffer(10_000), ctypes.c_size_t()
    for adios, io, _ in iterate_adios2_steps(path):
        attribute = ctypes.c_void_p(adios.adios2_inquire_attribute(io, b"vtk.xml"))
        assert adios.adios2_attribute_data(text, ctypes.byref(size), attribute) == 0
    return text.value.decode()


def read_blocks_of_all_writers(adios, engine, variable, step, dtype):
    # {int Dims; size_t *Shape; int IsValue, IsReverseDims; size_t nblocks; ...}
    count = adios.adios2_inquire_blockinfo(engine, variable, ctypes.c_size_t(step))[3]
    arrays = []
    for block in range(count):
        assert adios.adios2_set_block_selection(variable, ctypes.c_size_t(block)) == 0
        shape = (ctypes.c_size_t * 2)()
        assert adios.adios2_variable_count(shape, variable) == 0
        values = np.empty(tuple(shape), dtype=dtype)
        assert adios.adios2_get(engine, variable, as_c_pointer(values), ADIOS2_MODE_SYNC) == 0
        arrays.append(values)
    return np.concatenate(arrays) if arrays else None


def as_c_pointer(array):
    return array.ctypes.data_as(ctypes.c_void_p)
