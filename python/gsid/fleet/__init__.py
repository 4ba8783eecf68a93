"""One recipe over many units: plan, run, merge, and what the fleet tells. The verb is `gsid fleet`."""
