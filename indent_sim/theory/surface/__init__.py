"""What a surface does beyond carrying pressure: no slip."""
