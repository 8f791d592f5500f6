"""What tests share: oracles, tables of operations, marks. Nothing here is a test."""
