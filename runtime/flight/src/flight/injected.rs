//! Flights with faults that are injected on purpose.

use super::{Flight, FlightError};
use plumbline_simulator::{InjectedFault, InjectedFrames, InjectedImu};

impl Flight {
    /// Injects `faults` into the streams of the flight and into the calibration that its estimator is given, drawn with `seed`.
    /// Reads the first frame, if there are faults.
    ///
    /// # Errors
    /// When a fault needs a second camera that is not there, the first frame cannot be read, or a mistake makes the calibration
    /// invalid.
    pub fn with_injected(mut self, faults: &[InjectedFault], seed: u64) -> Result<Self, FlightError> {
        if faults.is_empty() {
            return Ok(self);
        }
        let cameras = self.config.camera.len();
        faults.iter().try_for_each(|fault| fault.check_cameras(cameras)).map_err(FlightError::Invalid)?;
        let mut sizes_px = [(0, 0); 2];
        for (size, camera) in sizes_px.iter_mut().zip(&self.config.camera) {
            let model = camera.model();
            *size = (model.width_px, model.height_px);
        }
        let stereo = InjectedFrames::start(self.stereo, sizes_px, faults, seed)?;
        self.imu = Box::new(InjectedImu::new(self.imu, &self.config.imu, stereo.begin(), faults, seed));
        self.stereo = Box::new(stereo);
        if faults.iter().any(InjectedFault::is_of_rig) {
            let mistake = |config: &mut _| faults.iter().for_each(|fault| fault.mistake(config));
            self.config = self.config.with("the calibration with the mistake of --fault", mistake)?;
        }
        self.injected.extend(faults);
        Ok(self)
    }
}
