"""Nav2's parameter files: read, audited against what Nav2 declares, and translated to the tree that configurations bind."""
