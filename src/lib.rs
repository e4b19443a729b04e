//! The `sunglint` program's workflows, one module per thing a person does.
