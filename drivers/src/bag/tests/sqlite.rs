//! Bags in databases of SQLite.

use super::*;
use rusqlite::{Connection, params};

const TABLES: &str = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
         serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
     CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);
     CREATE INDEX timestamp_idx ON messages (timestamp ASC);";

/// Writes messages of (topic, type, content) in this order; the database stays open.
fn recording(path: &Path, messages: &[(&str, &str, Vec<u8>)]) -> Connection {
    let database = Connection::open(path).unwrap();
    database.execute_batch(&format!("PRAGMA journal_mode = WAL; {TABLES} BEGIN")).unwrap();
    let mut topics = Vec::new();
    for (topic, type_name, content) in messages {
        if !topics.contains(topic) {
            topics.push(*topic);
            let row = params![topics.len() as i64, topic, type_name, "cdr", ""];
            database.execute("INSERT INTO topics VALUES(?1, ?2, ?3, ?4, ?5)", row).unwrap();
        }
        let number = 1 + topics.iter().position(|known| known == topic).unwrap() as i64;
        // Times of arrival are those of nobody.
        database
            .execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES(?1, 5, ?2)",
                params![number, content],
            )
            .unwrap();
    }
    database.execute_batch("COMMIT").unwrap();
    database
}

fn write(path: &Path, messages: &[(&str, &str, Vec<u8>)]) {
    recording(path, messages).close().unwrap();
}

fn names(folder: &Path) -> Vec<std::ffi::OsString> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    names
}

#[test]
fn a_database_is_a_bag_and_nothing_is_written_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    // What means something in a URI.
    let path = folder.path().join("50% of ä?#.db3");
    write(&path, &messages(Order::Little));
    let before = names(folder.path());
    check_whole(&path);
    check_whole(folder.path());
    assert_eq!(names(folder.path()), before);
}

#[test]
fn files_and_messages_compressed_by_zstandard_are_refused_with_the_cure() {
    let folder = tempfile::tempdir().unwrap();
    let all = messages(Order::Little);
    let path = folder.path().join("plain.db3");
    write(&path, &all);
    let packed = zstd::stream::encode_all(File::open(&path).unwrap(), 3).unwrap();
    let path = folder.path().join("file.db3.zstd");
    std::fs::write(&path, &packed).unwrap();
    let words = refusal(&path);
    assert!(words.contains("file.db3.zstd: ") && words.contains("zstd -d"), "{words}");
    let compressed: Vec<_> = all
        .into_iter()
        .map(|(topic, name, content)| (topic, name, zstd::stream::encode_all(content.as_slice(), 3).unwrap()))
        .collect();
    let path = folder.path().join("message.db3");
    write(&path, &compressed);
    assert!(refusal(&path).contains("ros2 bag convert"));
}

#[test]
fn what_its_recorder_left_in_the_journal_is_read() {
    let (folder, path) = place("killed.db3");
    let database = recording(&path, &messages(Order::Little));
    // As after a crash: the journal was not taken over.
    assert!(folder.path().join("killed.db3-wal").metadata().unwrap().len() > 0);
    let bag = BagDataset::open(&path, &BagTopics::default(), &options()).unwrap();
    assert!(bag.is_truncated());
    assert_eq!(frames(&bag), expected_frames());
    drop(database);
}

#[test]
fn a_database_that_breaks_off_is_refused_with_the_cure() {
    let (_folder, path) = place("cut.db3");
    write(&path, &messages(Order::Little));
    let whole = std::fs::read(&path).unwrap();
    for part in [0.0, 0.1, 0.5, 0.9] {
        std::fs::write(&path, &whole[..50 + (whole.len() as f64 * part) as usize]).unwrap();
        let words = refusal(&path);
        assert!(words.contains("is a damaged database") && words.contains(".recover"), "{part}: {words}");
    }
}

#[test]
fn damage_other_tables_and_tricks_of_a_schema_are_refused() {
    let (folder, path) = place("bag.db3");
    write(&path, &messages(Order::Little));
    let sound = std::fs::read(&path).unwrap();
    let mut bent = sound.clone();
    // Heads of the pages behind the schema.
    (1..sound.len() / 4096).for_each(|page| bent[page * 4096..][..8].fill(0xee));
    std::fs::write(&path, &bent).unwrap();
    let words = refusal(&path);
    assert!(words.contains("bag.db3: is a damaged database") && words.contains(".recover"), "{words}");
    let other = |name: &str, sql: &str| {
        let path = folder.path().join(name);
        Connection::open(&path).unwrap().execute_batch(sql).unwrap();
        refusal(&path)
    };
    let words = other("notes.db3", "CREATE TABLE notes(text)");
    assert!(words.contains("is a database, but no bag"), "{words}");
    let endless = "CREATE TABLE topics(id, name, type, serialization_format);
        CREATE VIEW messages AS WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n) SELECT k AS topic_id, k AS data FROM n";
    assert!(other("view.db3", endless).contains("is a database, but no bag"));
    let invented = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format);
        INSERT INTO topics VALUES(1, '/imu0', 'sensor_msgs/msg/Imu', 'cdr');
        CREATE TABLE messages(topic_id, timestamp, data AS (zeroblob(100000000)));
        INSERT INTO messages(topic_id) VALUES(1), (1), (1), (1)";
    let words = other("bomb.db3", invented);
    assert!(words.contains("holds more than its own length"), "{words}");
    let wrong = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format);
        INSERT INTO topics VALUES(1, x'00', 3, NULL); CREATE TABLE messages(topic_id, timestamp, data)";
    assert!(other("types.db3", wrong).contains("is a damaged database"));
}

#[test]
fn an_empty_recording_says_that_it_holds_nothing() {
    let (_folder, path) = place("empty.db3");
    write(&path, &[]);
    let words = refusal(&path);
    assert!(words.contains("empty.db3: holds no images") && words.contains("no topics at all"), "{words}");
}
