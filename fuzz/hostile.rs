//! Messages of a Zenoh peer whose lengths and numbers claim more than there is: every kind of message, with entries of the
//! dictionary (`fuzz/dictionaries/zenoh_transport.dict`) in the place of its bytes. Included by path where it is wanted.

/// The dictionary, in libFuzzer's format.
const DICTIONARY: &str = include_str!("dictionaries/zenoh_transport.dict");

/// Entries of the dictionary as bytes: `name="\xNN..."` a line.
pub fn dictionary() -> Vec<Vec<u8>> {
    let quoted = |line: &'static str| line.split_once('"')?.1.strip_suffix('"');
    let bytes =
        |text: &str| text.split("\\x").skip(1).filter_map(|hex| u8::from_str_radix(hex, 16).ok()).collect();
    DICTIONARY.lines().filter(|line| !line.starts_with('#')).filter_map(quoted).map(bytes).collect()
}

/// A number of the wire: seven bits a byte, the ninth byte has eight.
pub fn number(mut number: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while number > 0x7f && bytes.len() < 8 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
    bytes
}

/// An OAM message of link states around this body.
pub fn link_states(body: &[u8]) -> Vec<u8> {
    [&[0x5f, 0x01][..], &number(body.len() as u64), body].concat()
}

/// Bodies of link states that once made a router deaf, or ended it: a list, the links of a node and the number of a node.
pub fn hostile_link_states() -> Vec<Vec<u8>> {
    let zid = [0x0f_u8; 16];
    let node = |psid: u64| [&[1, 1][..], &number(psid), &[1, 16], &zid, &[0]].concat();
    let mut bodies = vec![
        number(1 << 62),
        [&[1, 0, 1, 5][..], &number(1 << 62)].concat(),
        [&[1, 4, 1, 5][..], &number(1 << 62)].concat(),
        [&[1, 8, 1, 5][..], &number(1 << 62)].concat(),
    ];
    bodies.extend([27, 40, 60, 62].map(|bits| node(1 << bits)));
    bodies.push(node(u64::MAX));
    bodies
}

/// Messages of every kind as they should be: declarations of a key, a subscriber, a queryable and a token, an end of one, an
/// interest, a query, an answer and its end, a sample, an OAM message of each form.
pub fn messages() -> Vec<Vec<u8>> {
    let key = |header: &[u8]| [header, &[5], b"a/b/c"].concat();
    vec![
        key(&[0x1e, 0x20, 1, 0]),
        key(&[0x1e, 0x62, 5, 0]),
        key(&[0x1e, 0x64, 6, 0]),
        key(&[0x1e, 0x66, 7, 0]),
        vec![0x1e, 0x23, 5],
        key(&[0x79, 3, 0x1f, 0]),
        [&key(&[0x7c, 9, 0])[..], &[0x03]].concat(),
        [&key(&[0x7b, 9, 0])[..], &[0x04, 0x01, 3, 1, 2, 3]].concat(),
        vec![0x1a, 9],
        [&key(&[0x7d, 0])[..], &[0x01, 3, 1, 2, 3]].concat(),
        vec![0x1f, 0x01],
        vec![0x3f, 0x01, 0x07],
        link_states(&[1, 1, 1, 5, 16, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 2, 1, 2]),
        link_states(&[2, 3, 1, 5, 1, 9, 1, 0, 0, 2, 5, 0]),
    ]
}

/// Draws messages, the same ones for the same seed.
pub struct Hostile {
    state: u64,
    messages: Vec<Vec<u8>>,
    dictionary: Vec<Vec<u8>>,
}

impl Hostile {
    /// Draws from this seed on.
    pub fn new(seed: u64) -> Self {
        Self { state: seed, messages: messages(), dictionary: dictionary() }
    }

    /// A message in which some bytes are entries of the dictionary.
    pub fn message(&mut self) -> Vec<u8> {
        let which = self.below(self.messages.len());
        let mut message = self.messages[which].clone();
        for _ in 0..1 + self.below(2) {
            let at = self.below(message.len()).max(1).min(message.len());
            let end = (at + self.below(3)).min(message.len());
            let entry = self.below(self.dictionary.len());
            message.splice(at..end, self.dictionary[entry].iter().copied());
        }
        message
    }

    /// Below `end`, which is above 0 (SplitMix64).
    pub fn below(&mut self, end: usize) -> usize {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % end as u64) as usize
    }
}
