//! Image pyramids, gradients and interpolation.
