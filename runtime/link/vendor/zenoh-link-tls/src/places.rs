//! PLUMBLINE: how many links there may be at a time, of all peers and of each certificate, and how many of them are kept for one
//! role. Without a bound of its own, one certificate could take all sessions and keep out every other for good.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// Key of an endpoint's configuration: `ALL|EACH|KEPT|ROLE`, such as `32|8|4|operator`: links at a time, those of one common
/// name, and those of the first that only names of this role may have (`operator`, `operator.1`).
pub(crate) const PLACES: &str = "places";
/// A refusal is logged this often at most.
const LOG_PERIOD: Duration = Duration::from_secs(30);

/// Bounds of a listener.
#[derive(Clone, Debug)]
pub(crate) struct Bounds {
    all: usize,
    each: usize,
    kept: usize,
    role: String,
}

impl Bounds {
    /// No bounds where none are given, or none that can be read.
    pub(crate) fn parse(text: Option<&str>) -> Option<Self> {
        let mut parts = text?.split('|');
        let mut number = || parts.next()?.parse().ok();
        let (all, each, kept) = (number()?, number()?, number()?);
        Some(Self { all, each, kept, role: parts.next()?.to_owned() })
    }

    fn is_kept_for(&self, name: &str) -> bool {
        name.rsplit_once('.').map_or(name, |(holder, _)| holder) == self.role
    }
}

/// Links that there are, by the common names of their certificates.
#[derive(Debug, Default)]
struct Taken {
    links: HashMap<String, usize>,
    logged: Option<Instant>,
}

/// Places of the links of a session, whatever listener they came by.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places(Arc<Mutex<Taken>>);

impl Places {
    fn lock(&self) -> MutexGuard<'_, Taken> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether another link of this name has a place; logs where it has none.
    pub(crate) fn has_room(&self, bounds: Option<&Bounds>, name: &str) -> bool {
        let Some(bounds) = bounds else { return true };
        let mut taken = self.lock();
        let own = taken.links.get(name).copied().unwrap_or_default();
        let free = bounds.all.saturating_sub(taken.links.values().sum());
        let kept = if bounds.is_kept_for(name) { 0 } else { bounds.kept };
        let has_room = own < bounds.each && free > kept;
        if !has_room && taken.logged.is_none_or(|logged| logged.elapsed() >= LOG_PERIOD) {
            taken.logged = Some(Instant::now());
            let Bounds { all, each, kept, role } = bounds;
            tracing::warn!(
                "no place for another session of {name}: it has {own}, and {free} of {all} are free ({each} are for one \
                 certificate at most, the last {kept} for {role} only); close other sessions, or exclude the certificate that \
                 has too many"
            );
        }
        has_room
    }

    /// A place for a link of this name, if there is one.
    pub(crate) fn take(&self, bounds: Option<&Bounds>, name: Option<&str>) -> Option<Place> {
        let name = name.unwrap_or_default();
        if !self.has_room(bounds, name) {
            return None;
        }
        *self.lock().links.entry(name.to_owned()).or_default() += 1;
        Some(Place { places: self.clone(), name: name.to_owned() })
    }
}

/// Place of a link, which is free again when this goes.
#[derive(Debug)]
pub(crate) struct Place {
    places: Places,
    name: String,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.lock();
        if let Some(count) = taken.links.get_mut(&self.name) {
            *count = count.saturating_sub(1);
            if *count == 0 {
                taken.links.remove(&self.name);
            }
        }
    }
}
