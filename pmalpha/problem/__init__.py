"""Description of a problem: subdomains, schemes, constraints, loads, restoring forces, springs."""
