"""Parameter estimation: a scene fitted to measured curves gives parameters with intervals."""
