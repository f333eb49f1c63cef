"""Parameter estimation, the inverse problem: parameters of a scene from measured curves."""
