"""What advances a coupled problem and keeps what came of it."""
