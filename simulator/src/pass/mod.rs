//! A pass: from orbit, attitude and target to spectra, magnitudes and count rates.
