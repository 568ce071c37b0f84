"""What a user describes: subdomains and schemes, constraints between them, loads, springs."""
