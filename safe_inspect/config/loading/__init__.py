"""Loading of YAML files into one tree: includes, merges, references, templates."""
