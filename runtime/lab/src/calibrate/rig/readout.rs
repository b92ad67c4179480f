//! The readout of a rolling shutter: the one with which the observations of a recording fit best.
//!
//! A wrong readout `T` displaces an observation by its image velocity times an error of its time that grows along the rows. So the mean
//! cost of an observation is a parabola in `T` about the right one, which is flattened far from it, where observations are outliers. It
//! is looked for on a coarse grid, then fitted through three readouts about the lowest cost, twice; the rig is free meanwhile, as its
//! calibration is not known yet. Every piece of the recording has a parabola of its own, and their scatter is the standard deviation.

use super::pass::pass;
use super::{RigError, RigOptions};
use plumbline_config::{ConfigError, ValidConfig};
use plumbline_flight::flight::{Flight, FlightError};

/// Readouts of the coarse search, s: no camera that a vehicle carries is slower than the last.
const COARSE_S: [f64; 5] = [0.0, 0.01, 0.02, 0.03, 0.04];
/// Distances of the two others from the readout in the middle of a fit, s.
const STEPS_S: [f64; 2] = [0.004, 0.002];
/// Passes of the whole search.
pub(super) const PASSES: usize = COARSE_S.len() + 3 * STEPS_S.len();
/// A readout within so many standard deviations of none is none.
const NONE_SIGMAS: f64 = 3.0;
/// A readout below this is none, s: the fastest rolling shutters take three milliseconds.
const NONE_S: f64 = 0.001;
/// Fewest parabolas whose scatter says something.
const LEAST_PIECES: usize = 3;

const NO_READOUT: &str = "the recording does not determine the readout of the shutter: how well it fits does not depend on it; move the \
                          rig faster, with texture in all rows of the images";

/// The readout that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundReadout {
    /// From the first row to the last, s; 0 for a global shutter.
    pub readout_s: f64,
    /// One standard deviation, s.
    pub sigma_s: f64,
}

/// Looks for the readout of both cameras; `progress` is told pass and frames so far.
pub(super) fn find(
    config: &ValidConfig,
    options: &RigOptions,
    open: &mut dyn FnMut(&ValidConfig) -> Result<Flight, FlightError>,
    progress: &mut dyn FnMut(usize, u64),
) -> Result<FoundReadout, RigError> {
    let mut number = 0;
    let mut costs_with = |readout_s: f64| -> Result<Vec<Option<f64>>, RigError> {
        number += 1;
        let config = with_readout(config, readout_s)?;
        let found =
            pass(open(&config)?, config.setup(), options.piece_s, &mut |frames| progress(number, frames))?;
        if found.pieces.len() < LEAST_PIECES {
            return Err(RigError::too_short(found.span_s, found.pieces.len(), options.piece_s, found.lost));
        }
        Ok(found.costs)
    };
    let mut coarse = Vec::with_capacity(COARSE_S.len());
    for readout_s in COARSE_S {
        coarse.push(costs_with(readout_s)?);
    }
    let mut middle_s = COARSE_S[lowest(&coarse)];
    let mut found = FoundReadout { readout_s: 0.0, sigma_s: 0.0 };
    for step_s in STEPS_S {
        // Below none there is nothing to measure, but the vertex may lie there.
        middle_s = middle_s.max(step_s);
        let [before, at, after] =
            [costs_with(middle_s - step_s)?, costs_with(middle_s)?, costs_with(middle_s + step_s)?];
        let vertices: Vec<f64> = (0..at.len())
            .filter_map(|k| {
                Some(vertex([(*before.get(k)?)?, at[k]?, (*after.get(k)?)?])? * step_s + middle_s)
            })
            .collect();
        found = mean(&vertices).ok_or_else(|| RigError::Unseen(NO_READOUT.into()))?;
        middle_s = found.readout_s;
    }
    if found.readout_s < NONE_S.max(NONE_SIGMAS * found.sigma_s) {
        found.readout_s = 0.0;
    }
    Ok(found)
}

/// `config` with this readout of every camera.
pub(super) fn with_readout(config: &ValidConfig, readout_s: f64) -> Result<ValidConfig, ConfigError> {
    config.with("calibrate rig", |config| {
        config.camera.iter_mut().for_each(|camera| camera.readout_s = readout_s)
    })
}

/// The set with the lowest mean over the pieces that all of them have.
fn lowest(costs: &[Vec<Option<f64>>]) -> usize {
    let pieces = costs.iter().map(Vec::len).min().unwrap_or(0);
    let shared: Vec<usize> = (0..pieces).filter(|k| costs.iter().all(|set| set[*k].is_some())).collect();
    let sum = |set: &Vec<Option<f64>>| shared.iter().filter_map(|k| set[*k]).sum::<f64>();
    let order = |a: &usize, b: &usize| sum(&costs[*a]).total_cmp(&sum(&costs[*b]));
    (0..costs.len()).min_by(order).unwrap_or(0)
}

/// Where the parabola through costs at -1, 0 and 1 is lowest; `None` where it has no lowest place nearby.
fn vertex([before, at, after]: [f64; 3]) -> Option<f64> {
    let curvature = before - 2.0 * at + after;
    let place = 0.5 * (before - after) / curvature;
    (curvature > 0.0 && place.abs() <= 3.0).then_some(place)
}

/// Mean of the vertices, and its standard deviation by their scatter.
fn mean(vertices_s: &[f64]) -> Option<FoundReadout> {
    let count = vertices_s.len() as f64;
    if vertices_s.len() < LEAST_PIECES {
        return None;
    }
    let readout_s = vertices_s.iter().sum::<f64>() / count;
    let scatter2 = vertices_s.iter().map(|v| (v - readout_s) * (v - readout_s)).sum::<f64>() / (count - 1.0);
    Some(FoundReadout { readout_s: readout_s.max(0.0), sigma_s: (scatter2 / count).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_vertex_of_a_parabola_is_found_and_a_slope_has_none() {
        let costs = |vertex: f64| [-1.0, 0.0, 1.0].map(|x: f64| 2.0 + 0.7 * (x - vertex) * (x - vertex));
        assert!((vertex(costs(0.4)).unwrap() - 0.4).abs() < 1e-12);
        assert_eq!(vertex([3.0, 2.0, 1.0]), None);
        assert_eq!(vertex([1.0, 2.0, 1.0]), None);
    }

    #[test]
    fn pieces_that_one_readout_lost_are_compared_with_none() {
        let costs = [vec![Some(3.0), None, Some(3.0)], vec![Some(2.0), Some(9.0), Some(2.0)]];
        assert_eq!(lowest(&costs), 1);
    }

    #[test]
    fn the_scatter_of_the_pieces_is_the_standard_deviation() {
        let found = mean(&[0.019, 0.021, 0.019, 0.021]).unwrap();
        assert!(
            (found.readout_s - 0.02).abs() < 1e-12 && (found.sigma_s - 0.577e-3).abs() < 1e-5,
            "{found:?}"
        );
        assert_eq!(mean(&[0.02; 2]), None);
    }
}
