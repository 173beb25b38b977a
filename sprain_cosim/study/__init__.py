"""Many landings: a study described, run by workers, kept in a ledger, summarised."""
