//! Row of the table of topics, and the macro that the table is written with.

use crate::fields::{Outline, Parts, Record};
use crate::protobuf::decode;

/// Priority of a key of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Priority {
    /// Before everything else, and at once.
    RealTime,
    /// Commands and health.
    InteractiveHigh,
    /// Estimates.
    DataHigh,
    /// The map.
    Data,
    /// Display only.
    DataLow,
    /// Bulk data, as much as the link carries.
    Background,
}

/// Key of the network that a topic is published on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkKey {
    /// Key below `plumbline/<vehicle>/`.
    pub name: &'static str,
    /// Priority. What finds no room on the link is dropped.
    pub priority: Priority,
    /// Messages a second over LAN, WiFi and radio; infinity is everything, zero nothing.
    pub rates_hz: [f64; 3],
}

/// Question that is answered with the message of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Question {
    /// Key below `plumbline/<vehicle>/`.
    pub name: &'static str,
    /// True for a command, false for a question.
    pub is_command: bool,
    /// True if answers have keys of their own below it.
    pub has_several: bool,
}

/// When readers of the local socket receive a kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subscription {
    /// By rules of its own.
    Other,
    /// When they subscribe to it.
    Asked,
    /// From the beginning.
    Always,
}

/// Reads the message of a topic, or says what is wrong with it.
pub type Decode = fn(&[u8]) -> Result<Box<dyn Parts>, &'static str>;

/// Row of a topic.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Description for the documents.
    pub about: &'static str,
    /// Name of its message with its package; empty for a fixed layout alone.
    pub message: &'static str,
    /// Reads its message; none for a fixed layout, and for what is drawn.
    pub decode: Option<Decode>,
    /// Schema of its message.
    pub(crate) schema: Option<Outline>,
    /// Channel of the log.
    pub log: Option<&'static str>,
    /// True if a re-execution needs it.
    pub is_input: bool,
    /// Number of its kind on the local socket; 0 for none.
    pub kind: u16,
    /// When readers of the local socket receive it.
    pub subscription: Subscription,
    /// Key of the network.
    pub key: Option<NetworkKey>,
    /// Question that it answers.
    pub question: Option<Question>,
}

/// Everything that is published.
pub(crate) const ALL_OF_IT: [f64; 3] = [f64::INFINITY; 3];

impl Row {
    pub(crate) const fn of(about: &'static str, message: &'static str) -> Self {
        Self {
            about,
            message,
            decode: None,
            schema: None,
            log: None,
            is_input: false,
            kind: 0,
            subscription: Subscription::Other,
            key: None,
            question: None,
        }
    }

    pub(crate) const fn record<T: Record>(mut self) -> Self {
        self.decode = Some(|bytes| Ok(Box::new(decode::<T>(bytes)?)));
        self.schema = Some(Outline::of::<T>());
        self
    }

    pub(crate) const fn log(mut self, topic: &'static str) -> Self {
        self.log = Some(topic);
        self
    }

    pub(crate) const fn input(mut self) -> Self {
        self.is_input = true;
        self
    }

    pub(crate) const fn kind(mut self, kind: u16, subscription: Subscription) -> Self {
        (self.kind, self.subscription) = (kind, subscription);
        self
    }

    pub(crate) const fn key(mut self, name: &'static str, priority: Priority, rates_hz: [f64; 3]) -> Self {
        self.key = Some(NetworkKey { name, priority, rates_hz });
        self
    }

    pub(crate) const fn answers(mut self, name: &'static str) -> Self {
        self.question = Some(Question { name, is_command: false, has_several: false });
        self
    }

    pub(crate) const fn answers_each(mut self, name: &'static str) -> Self {
        self.question = Some(Question { name, is_command: false, has_several: true });
        self
    }

    pub(crate) const fn commands(mut self, name: &'static str) -> Self {
        self.question = Some(Question { name, is_command: true, has_several: false });
        self
    }
}

/// Defines the topics by their rows: description, name, the variant of [`Said`] and its type where a stage says it, message, ways.
macro_rules! topics {
    ($($(#[doc = $about:literal])+ $topic:ident $(($said:ident: $held:ty))? = $message:literal $(. $way:ident $(::<$record:ty>)? ($($of:tt)*))*;)*) => {
        /// Something that a flight says.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Topic {
            $($(#[doc = $about])+ $topic,)*
        }

        /// Input, order, output or event of a flight: a value of fixed size, copied without allocation. Images are handed over
        /// apart.
        // The estimate is the largest by far, and boxing it would allocate.
        #[allow(clippy::large_enum_variant)]
        #[derive(Clone, Debug)]
        pub enum Said {
            $($(
                #[doc = concat!("Record of [`Topic::", stringify!($topic), "`].")]
                $said($held),
            )?)*
        }

        impl Said {
            /// Its topic.
            pub const fn topic(&self) -> Topic {
                match self {
                    $($(Self::$said(_) => Topic::$topic,)?)*
                }
            }

            /// Its record; none for an event, which is drawn.
            pub fn record(&self) -> Option<&dyn $crate::fields::Parts> {
                match self {
                    $($(Self::$said(record) => $crate::said::Told::record(record),)?)*
                }
            }
        }

        impl Topic {
            /// Every topic, in the order of the enumeration.
            pub const ALL: [Self; [$(stringify!($topic)),*].len()] = [$(Self::$topic),*];

            /// Its row.
            #[must_use]
            pub const fn row(self) -> &'static $crate::row::Row {
                const ROWS: [$crate::row::Row; Topic::ALL.len()] =
                    [$($crate::row::Row::of(concat!($($about),+).trim_ascii(), $message)$(.$way $(::<$record>)? ($($of)*))*),*];
                &ROWS[self as usize]
            }
        }
    };
}
