"""Points seen by a camera, summed sheet by sheet under a filter."""
