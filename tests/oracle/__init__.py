"""An independent solver in NumPy and SciPy, which shares no code with the library.

It has reference elements (`elements`), matrices and loads (`assembly`), frictional contact by
nonlinear Gauss-Seidel on a dense compliance matrix (`contact`), and eigenvalues of pairs of
matrices (`eigen`). It is small and slow. Tests compare its results with those of the library.
"""
