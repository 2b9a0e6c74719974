"""Fluxes at prescribed nodes: their page, exact solutions of graded conduction, and Trefftz's method."""
