"""A scene file and the Config it describes."""
