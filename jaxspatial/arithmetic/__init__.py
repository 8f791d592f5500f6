"""Layer 0: how numbers are added and multiplied. Every formula of the library goes through here."""
