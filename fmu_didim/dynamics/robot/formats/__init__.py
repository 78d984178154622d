"""Robot descriptions in the formats of others: URDF in and out, MJCF out."""
