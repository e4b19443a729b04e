//! A network of one's own: a test runs itself again where nobody else can reach its server.
