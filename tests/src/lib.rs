//! Shared support of the system tests.
