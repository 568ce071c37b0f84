"""Set-up, once for each Coupler: elimination order, factors, interface matrix, start."""
