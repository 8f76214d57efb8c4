"""Studies: what the paper claims, measured by flying the product; the reproduction ledger is made from them."""
