//! Row of the table of topics.

use crate::fields::{About, Enumeration, Parts, Record, Shape};
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
pub struct Key {
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
    pub(crate) schema: Option<fn() -> Message>,
    /// Channel of the log.
    pub log: Option<&'static str>,
    /// True if a re-execution needs it.
    pub is_input: bool,
    /// Number of its kind on the local socket; 0 for none.
    pub kind: u16,
    /// When readers of the local socket receive it.
    pub subscription: Subscription,
    /// Key of the network.
    pub key: Option<Key>,
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
        self.schema = Some(Message::of::<T>);
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
        self.key = Some(Key { name, priority, rates_hz });
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

/// A message of the schema.
pub(crate) struct Message {
    pub name: &'static str,
    #[cfg(test)]
    pub about: &'static str,
    pub fields: Vec<&'static About>,
}

impl Message {
    pub fn of<T: Record>() -> Self {
        let fields = T::FIELDS.iter().map(|field| &field.about).filter(|about| about.tag > 0).collect();
        Self {
            name: T::NAME,
            #[cfg(test)]
            about: T::ABOUT,
            fields,
        }
    }

    /// Enumerations that its fields have, those inside the message or those outside it.
    pub fn enumerations(&self, is_inside: bool) -> impl Iterator<Item = &'static Enumeration> {
        let of = |about: &&About| match about.shape {
            Shape::Enumerator(of) => Some(of),
            _ => None,
        };
        self.fields.iter().filter_map(of).filter(move |of| of.name.contains('.') == is_inside)
    }
}
