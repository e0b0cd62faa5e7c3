"""Drive one scenario with several seeds in parallel processes: the result does not depend on their number."""

import navstack as nav

if __name__ == "__main__":
    table = nav.simulate_many("narrow_door", count=6, processes=2)
    print(table)
    print(f"success rate: {table.success_rate:.2f}")
