//! ROS 1 bags, record by record.

use super::*;
use std::io::Write;

fn block(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let field = |(name, value): &(&str, &[u8])| block(&[name.as_bytes(), b"=", *value].concat());
    let header: Vec<u8> = fields.iter().flat_map(field).collect();
    [block(&header), block(data)].concat()
}

/// The record at the beginning: where the index is, 0 while the recorder is not done.
fn head(index_at: u64) -> Vec<u8> {
    record(
        &[("op", &[3]), ("index_pos", &index_at.to_le_bytes()), ("conn_count", &[3, 0, 0, 0])],
        &[b' '; 300],
    )
}

/// Connections and messages, each connection where it is first needed.
fn records(messages: &[(&str, &str, Vec<u8>)]) -> Vec<Vec<u8>> {
    let (mut topics, mut all) = (Vec::new(), Vec::new());
    for (topic, type_name, content) in messages {
        if !topics.contains(topic) {
            topics.push(*topic);
            let number = (topics.len() as u32 - 1).to_le_bytes();
            let about: Vec<u8> = ["topic=/x", &format!("type={type_name}"), "md5sum=*"]
                .iter()
                .flat_map(|text| block(text.as_bytes()))
                .collect();
            all.push(record(&[("op", &[7]), ("conn", &number), ("topic", topic.as_bytes())], &about));
        }
        let number = topics.iter().position(|known| known == topic).unwrap() as u32;
        all.push(record(&[("op", &[2]), ("conn", &number.to_le_bytes()), ("time", &[5; 8])], content));
    }
    all
}

fn chunk(compression: &str, content: &[u8]) -> Vec<u8> {
    let packed = match compression {
        "none" => content.to_vec(),
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        }
        _ => {
            let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
            encoder.write_all(content).unwrap();
            encoder.finish().0
        }
    };
    let size = (content.len() as u32).to_le_bytes();
    record(&[("op", &[5]), ("compression", compression.as_bytes()), ("size", &size)], &packed)
}

const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// A whole bag, with an index that nobody needs.
fn bag(compression: &str, messages: &[(&str, &str, Vec<u8>)]) -> Vec<u8> {
    let chunks: Vec<u8> = records(messages)
        .chunks(20)
        .flat_map(|some| {
            [chunk(compression, &some.concat()), record(&[("op", &[4]), ("ver", &[1, 0, 0, 0])], &[9; 24])]
                .concat()
        })
        .collect();
    let index_at = MAGIC.len() + head(0).len() + chunks.len();
    let index = record(&[("op", &[6]), ("ver", &[1, 0, 0, 0])], &[9; 8]);
    [MAGIC, &head(index_at as u64), &chunks, &index].concat()
}

#[test]
fn bags_of_ros_1_are_read_however_their_chunks_are_compressed() {
    let folder = tempfile::tempdir().unwrap();
    for compression in ["none", "bz2", "lz4"] {
        let path = folder.path().join(format!("{compression}.bag"));
        std::fs::write(&path, bag(compression, &messages(Order::Ros1))).unwrap();
        check_whole(&path);
    }
}

#[test]
fn a_bag_whose_recorder_was_killed_is_read_to_its_end() {
    let (_folder, path) = place("killed.bag.active");
    let records = records(&messages(Order::Ros1));
    let (first, second) = records.split_at(100);
    // The chunk that was open has no length yet; its records follow.
    let open = record(&[("op", &[5]), ("compression", b"none"), ("size", &[0; 4])], &[]);
    let bytes = [MAGIC, &head(0), &chunk("none", &first.concat()), &open, &second.concat()].concat();
    for cut in [0, 5] {
        std::fs::write(&path, &bytes[..bytes.len() - cut]).unwrap();
        let bag = BagDataset::open(&path, &BagTopics::default(), &options()).unwrap();
        assert!(bag.is_truncated());
        let mut expected = expected_frames();
        if cut > 0 {
            expected.last_mut().unwrap().2[1] = None;
        }
        assert_eq!(frames(&bag), expected);
    }
    let whole = super::ros1::bag("lz4", &messages(Order::Ros1));
    std::fs::write(&path, &whole[..whole.len() * 6 / 10]).unwrap();
    let bag = BagDataset::open(&path, &BagTopics::default(), &options()).unwrap();
    assert!(bag.is_truncated() && (2..9).contains(&frames(&bag).len()));
}

#[test]
fn damage_bombs_and_other_versions_are_refused() {
    let (_folder, path) = place("bent.bag");
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        refusal(&path)
    };
    let with = |record: Vec<u8>| [MAGIC, &head(1), &record].concat();
    let sized = |size: u32, compression: &[u8], data: &[u8]| {
        with(record(&[("op", &[5]), ("compression", compression), ("size", &size.to_le_bytes())], data))
    };
    let zeros = chunk("bz2", &vec![0; 16 << 20]);
    for (bytes, words) in [
        (b"#ROSBAG V1.2\nand more of it".to_vec(), "another version"),
        (with(record(&[("op", &[3]), ("encryptor", b"rosbag/AesCbcEncryptor")], b"")), "encrypted"),
        (with(record(&[("conn", &[1, 0, 0, 0])], b"")), "a record of no kind"),
        (with(record(&[("op", &[2])], b"")), "a message of no connection"),
        (with(record(&[("op", &[7])], b"")), "a connection without number"),
        (with([&7_u32.to_le_bytes()[..], &[255; 4], b"op="].concat()), "longer than its header"),
        (with(block(&block(b"no equals"))), "a field without a value"),
        (with(vec![255; 8]), "a length of 4294967295 bytes"),
        (with([block(&block(b"op=\x02")), vec![255; 4]].concat()), "a length of 4294967295 bytes"),
        (sized(9, b"none", b"eight by"), "has not the size"),
        (sized(7, b"bz2", b"no bzip2"), "cannot be unpacked"),
        (sized(7, b"lz4", b"no lz4 at all"), "cannot be unpacked"),
        (sized(7, b"xz", b"anything"), "another way than bz2 or lz4"),
        (sized(u32::MAX, b"bz2", b"anything"), "a length of 4294967295 bytes"),
        (sized(8, b"none", &[9, 0, 0, 0, 1, 2, 3, 4]), "longer than its chunk"),
        // A record of each of whose bytes is another of no length.
        ([&with(Vec::new())[..], &zeros.repeat(9)].concat(), "a record of no kind"),
    ] {
        let found = refused(&bytes);
        assert!(found.contains("bent.bag: ") && found.contains(words), "{words}: {found}");
    }
    let idle = record(&[("op", &[4])], &[]).repeat(1 << 20);
    let found = refused(&with(chunk("bz2", &idle)));
    assert!(found.contains("expands to far more records"), "{found}");
}

#[test]
fn parts_of_one_recording_follow_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let all = messages(Order::Ros1);
    let (first, second) = all.split_at(50);
    std::fs::write(folder.path().join("b_0.bag"), bag("none", first)).unwrap();
    std::fs::write(folder.path().join("b_1.bag"), bag("lz4", second)).unwrap();
    check_whole(folder.path());
}
