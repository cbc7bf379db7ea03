"""Write FMUs: from variables.toml to C tables, model description and archive."""
