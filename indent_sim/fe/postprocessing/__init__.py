"""What is read off a solution: the contact surface, contact radius and pressure, fields."""
