"""Virtual lab: physics in place of an instrument. Nothing that processes data imports it."""
