"""A scene and measured curves -> parameters with intervals."""
