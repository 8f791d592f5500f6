"""Ways to add products up with their errors: twice the precision, certified, and as much as it takes."""
