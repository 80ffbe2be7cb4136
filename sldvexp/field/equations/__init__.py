"""Normal equations of a field: regions of samples, elements, assembly, undetermined nodes."""
