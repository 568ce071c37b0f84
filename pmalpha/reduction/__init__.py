"""Few coordinates for many: fixed dofs, modes, superelements."""
