"""Methods and ablations, trained and measured on one capture under the same conditions."""
