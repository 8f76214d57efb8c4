"""A receiver of pseudoranges and its sky: where satellites are, what is measured of them, what goes wrong, frames."""
