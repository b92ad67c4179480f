//! System tests, one module a behaviour.
