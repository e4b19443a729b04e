//! Text and JSON of the devices commands.
