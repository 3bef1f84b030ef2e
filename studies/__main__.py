"""`python -m studies`: list the studies."""

from studies import STUDIES


def main() -> int:
    """Print one line per study; returns 0."""
    print("Run one with `python -m studies.NAME`; --help shows its options.\n")
    for name, (measures, duration) in STUDIES.items():
        print(f"{name:<16} {measures} ({duration})")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
