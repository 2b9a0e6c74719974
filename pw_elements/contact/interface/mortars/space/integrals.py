"""Result of the integration over overlaps of sub-facets, in coordinates of the slave."""

from dataclasses import dataclass

from pw_elements.arrays import Array


@dataclass(frozen=True)
class OverlapIntegrals:
    """Integrals over q overlaps in coordinates of the slave, and derivatives.

    Sub-facets of the slave have k corners and those of the master l corners; b is the number of
    bubble functions of both, and z that of the variables on which the integrals depend.

    Args:
        slave_products: (q, k (k + 1) / 2), integrals of the products of two weight functions of the
            slave, in the order of `number_unique_products`.
        slave_products_rate: (q, k (k + 1) / 2, z), their derivatives.
        mixed_products: (q, k, l), integrals of a weight function of the slave times one of the
            master.
        mixed_products_rate: (q, k, l, z), their derivatives.
        bubble_products: (q, k, b), integrals of a weight function of the slave times the factor of
            each second difference in the distance of the slave from the master.
        bubble_products_rate: (q, k, b, z), their derivatives.
    """

    slave_products: Array
    slave_products_rate: Array
    mixed_products: Array
    mixed_products_rate: Array
    bubble_products: Array
    bubble_products_rate: Array
