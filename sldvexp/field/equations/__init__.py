"""A field's normal equations: regions, elements, assembly, what is undetermined."""
