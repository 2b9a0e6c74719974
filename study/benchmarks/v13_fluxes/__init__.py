"""Fluxes at prescribed nodes: page, exact solutions of graded conduction, Trefftz's method."""
