"""The verb ``excite``: the motion on which a log will tell most of the parameters."""
