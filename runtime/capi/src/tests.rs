//! Checks beyond the compiler's: the header, and the structures that are records of the local socket.

use crate::call::call;
use crate::handles::Registry;
use crate::pointers::from_record;
use crate::status::{CallFailure, Error, Status};
use crate::types::{Estimate, Instant, Odometry};
use crate::version::PLUMBLINE_ABI;
use plumbline_record::fields::Record;
use plumbline_record::{InstantAnswer, InstantSource, layout};
use std::ffi::CStr;
use std::mem::offset_of;
use std::path::Path;
use std::sync::mpsc;
use std::thread;

/// The header that is installed is the one that cbindgen makes of the sources. PLUMBLINE_WRITE_HEADER=1 writes it.
#[test]
fn the_header_is_current() {
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(crate_folder.join("cbindgen.toml")).unwrap();
    let bindings = cbindgen::Builder::new().with_crate(crate_folder).with_config(config).generate().unwrap();
    let mut header = Vec::new();
    bindings.write(&mut header);
    let header = String::from_utf8(header).unwrap();
    let file = crate_folder.join("include/plumbline.h");
    if std::env::var_os("PLUMBLINE_WRITE_HEADER").is_some() {
        std::fs::write(&file, &header).unwrap();
    }
    assert_eq!(std::fs::read_to_string(file).unwrap(), header, "make capi-header writes include/plumbline.h");
}

#[test]
fn the_soname_has_the_number_of_the_interface() {
    let build = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("build.rs")).unwrap();
    assert!(build.contains(&format!("-soname,libplumbline.so.{PLUMBLINE_ABI}\"")));
}

/// Places of fields by the tables of the records, with those of the parts of a record.
fn places<T: Record>() -> Vec<(&'static str, usize)> {
    T::FIELDS.iter().filter_map(|field| Some((field.about.name, field.about.at?))).collect()
}

#[test]
fn structures_have_the_layout_of_the_records() {
    macro_rules! places_of {
        ($type:ident: $($table:literal is $field:ident),*) => {
            vec![$(($table, offset_of!($type, $field))),*]
        };
    }
    let odometry = places_of!(Odometry: "sequence" is sequence, "stamp" is stamp_ns, "pose_o_b" is position_m, "v_o_b" is velocity_m_s,
        "angular_rate_b" is rate_rad_s, "covariance" is covariance, "state" is state, "quality" is quality,
        "reset_counter" is reset_counter, "jumps" is jumps);
    assert_eq!(places::<plumbline_estimator::Odometry>(), odometry);
    assert_eq!((size_of::<Odometry>(), offset_of!(Odometry, rotation_xyzw)), (layout::ODOMETRY_BYTES, 48));
    let estimate = places_of!(Estimate: "frame_sequence" is sequence, "stamp" is stamp_ns, "state" is state, "pose_o_b" is position_m,
        "v_o_b" is velocity_m_s, "bias_gyro" is bias_gyro_rad_s, "bias_accel" is bias_accel_m_s2, "covariance" is covariance,
        "time_offset_s" is time_offset_s, "quality" is quality, "health" is health, "reset_counter" is reset_counter);
    assert_eq!(places::<plumbline_estimator::Estimate>(), estimate);
    assert_eq!((size_of::<Estimate>(), offset_of!(Estimate, rotation_xyzw)), (layout::ESTIMATE_BYTES, 48));
    let instant = places_of!(Instant: "number" is number, "outcome" is outcome, "stamp" is stamp_ns, "pose_o_b" is position_m,
        "v_o_b" is velocity_m_s, "angular_rate_b" is rate_rad_s, "covariance" is covariance, "state" is state, "quality" is quality,
        "reset_counter" is reset_counter, "estimated" is estimated_ns, "is_settled" is is_settled);
    assert_eq!(places::<plumbline_record::InstantAnswer>(), instant);
    assert_eq!((size_of::<Instant>(), offset_of!(Instant, rotation_xyzw)), (layout::INSTANT_BYTES, 48));
}

#[test]
fn what_no_table_names_is_where_the_layouts_put_it() {
    let mut bytes = Vec::new();
    layout::put_odometry(&plumbline_estimator::Odometry::default(), 77, 9, &mut bytes);
    let odometry: Odometry = from_record(&bytes).unwrap();
    assert_eq!((odometry.handed_over_ns, odometry.health, odometry.reserved), (77, 9, [0; 2]));
    bytes.clear();
    let mut estimate = plumbline_estimator::Estimate::default();
    estimate.figures.is_keyframe = true;
    layout::put_estimate(&estimate, 78, &mut bytes);
    let estimate: Estimate = from_record(&bytes).unwrap();
    assert_eq!((estimate.handed_over_ns, estimate.is_keyframe, estimate.reserved), (78, 1, [0; 5]));
    assert!(from_record::<Estimate>(&bytes[1..]).is_none());
    bytes.clear();
    let answer = InstantAnswer { source: InstantSource::Trigger, ..InstantAnswer::default() };
    layout::put_instant(&answer, 79, &mut bytes);
    let instant: Instant = from_record(&bytes).unwrap();
    assert_eq!((instant.handed_over_ns, instant.source, instant.reserved), (79, 1, [0; 7]));
}

#[test]
fn a_panic_becomes_a_status_and_poisons_its_handle_alone() {
    static NUMBERS: Registry<u32> = Registry::new();
    let (first, second) = (NUMBERS.add(1), NUMBERS.add(2));
    let mut error = Error { status: Status::Ok, text: [1; 1020] };
    let broken = call(&raw mut error, || NUMBERS.with(first, |_| panic!("broken {}", 7)));
    let text = error.text.map(|c| c as u8);
    let text = CStr::from_bytes_until_nul(&text).unwrap().to_str().unwrap();
    assert_eq!((broken, error.status), (Status::Panic, Status::Panic));
    assert!(text.contains("broken 7"), "{text}");
    let use_of = |handle| NUMBERS.with(handle, |n| Ok(*n)).map_err(|failure| failure.status);
    assert_eq!(use_of(first), Err(Status::Poisoned));
    assert_eq!(use_of(second), Ok(2));
    NUMBERS.free(first).unwrap();
    assert_eq!(use_of(first), Err(Status::BadHandle));
}

#[test]
fn a_handle_in_use_is_refused_to_a_second_thread_and_not_freed() {
    static NUMBERS: Registry<u32> = Registry::new();
    let handle = NUMBERS.add(1);
    let ((is_in, inside), (go, gone)) = (mpsc::channel(), mpsc::channel::<()>());
    let first = thread::spawn(move || {
        NUMBERS.with(handle, |_| {
            is_in.send(()).unwrap();
            gone.recv().unwrap();
            Ok(())
        })
    });
    inside.recv().unwrap();
    let status = |outcome: Result<(), CallFailure>| outcome.map_err(|failure| failure.status);
    assert_eq!(status(NUMBERS.with(handle, |_| Ok(()))), Err(Status::Busy));
    assert_eq!(status(NUMBERS.free(handle)), Err(Status::Busy));
    go.send(()).unwrap();
    first.join().unwrap().unwrap();
    assert_eq!(status(NUMBERS.free(handle)), Ok(()));
}
