"""What is done once, when a Coupler is made: order, factors, interface matrix, start."""
