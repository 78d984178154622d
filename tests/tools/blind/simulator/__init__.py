"""An independent simulator of planar arms with hidden effects, and the case folders made with it."""
