"""The steps that follow the import, each of which fills in maps or files of the workspace."""
