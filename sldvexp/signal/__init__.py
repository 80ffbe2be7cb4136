"""From sampled channels to complex pixels: the sine fit of Section 3.2.3."""
