"""What a surface does beyond carrying pressure: adhesion, rate, and no slip."""
