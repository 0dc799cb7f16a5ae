"""From YAML files to one tree: includes, merges, references, templates."""
