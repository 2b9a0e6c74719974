"""A second solver, which shares nothing with the library: NumPy and SciPy alone.

Reference elements (`elements`), matrices and loads (`assembly`), frictional contact by nonlinear
Gauss-Seidel on a dense compliance (`contact`), the least eigenvalues of a pair (`eigen`). It is
here to disagree with the library if one of the two is wrong; it is small and slow.
"""
