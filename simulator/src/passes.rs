//! When a target can be seen from a site.
