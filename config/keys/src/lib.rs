//! Declarations beside the field: keys of a configuration by the attribute `#[keys]`, and records by `#[derive(Record)]`.
//!
//! # Keys, for the crate `plumbline-config`
//!
//! ```text
//! /// Detection and tracking of points.
//! #[keys]
//! #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
//! #[serde(deny_unknown_fields)]
//! pub struct PointsConfig {
//!     /// Largest number of points tracked at a time.
//!     #[key(default = 120, range = 8..=2000)]
//!     pub max_points: usize,
//! }
//! ```
//!
//! A field's `#[key(...)]` has, each where it applies:
//!
//! - `default = VALUE`, or `default` for that of the type. A key without it is required;
//! - `range = LOW..=HIGH`, ends included;
//! - `unit = UNIT`, one of `crate::keys`, whose cure a refused value is told;
//! - `cure = "..."`, for a value whose cure is another;
//! - `experiment`, for a key that no user has a reason to turn: it can be set, and no list shows it.
//!
//! The keys of the table (`crate::keys::Table`), serde's defaults and `Default` (`with_required` where keys are required) are made from a
//! struct; the words that a key may have from an enum. The comment of a field is the text of its key.
//!
//! # Records, for the crate `plumbline-fields`
//!
//! ```text
//! /// The newest state at an inertial sample.
//! #[derive(Default, Record)]
//! #[record("Odometry")]
//! pub struct Odometry {
//!     /// Time of the inertial sample.
//!     #[field(2, wire = "stamp_ns", digest = 1, at = 0)]
//!     pub stamp: Timestamp,
//! }
//! ```
//!
//! A record has the name of its message, and after it fields that are more than one place of it (`Field`). A field has its number in
//! messages, and each where it applies:
//!
//! - `wire = "..."`, its name in the schema, if that is another, and `about = "..."` for another text than its comment;
//! - `path = NAME`, for a field of the field; `pair = NAME`, for another that is one field with it;
//! - `digest = PLACE`, place in the digest, from 1; `digest_as = |o| ...`, for another value there;
//! - `at = BYTE`, first byte in the fixed layout of the local socket;
//! - `columns = (PLACE, &["..."])`, place among the columns of a table, from 1, and their names;
//! - `most = COUNT`, the bound of what comes from the network; `one`, a single number; `single`, numbers of single precision;
//! - `none` alone, for what is left out on purpose.
//!
//! Numbers, places and bytes are those of logs, digests and programs that exist: a new field takes the next number. An enumeration has
//! `#[record("Name", "an unknown name")]`, and its enumerators count from 1 in messages.

mod key;
mod record;

use key::KeyDeclaration;
use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::{Data, DeriveInput, Error, Field, Fields, Ident, Result, parse_macro_input, parse_quote};

/// Makes a struct a table of the configuration, and an enum a choice of words.
#[proc_macro_attribute]
pub fn keys(_: proc_macro::TokenStream, item: proc_macro::TokenStream) -> proc_macro::TokenStream {
    let mut input = parse_macro_input!(item as DeriveInput);
    let name = input.ident.clone();
    let made = match &mut input.data {
        Data::Struct(data) => of_table(&name, &mut data.fields),
        Data::Enum(_) => Ok(of_words(&name)),
        Data::Union(_) => {
            Err(Error::new(name.span(), "a table of keys is a struct, a choice of words an enum"))
        }
    };
    let made = made.unwrap_or_else(Error::into_compile_error);
    quote!(#input #made).into()
}

/// Makes a struct a record, and an enumeration a field of records.
#[proc_macro_derive(Record, attributes(record, field))]
pub fn record(item: proc_macro::TokenStream) -> proc_macro::TokenStream {
    let input = parse_macro_input!(item as DeriveInput);
    record::of(&input).unwrap_or_else(Error::into_compile_error).into()
}

/// A field with its key.
struct Entry {
    field: Field,
    key: KeyDeclaration,
}

impl Entry {
    fn name(&self) -> &Ident {
        self.field.ident.as_ref().expect("a named field has a name")
    }

    fn default_function(&self) -> Ident {
        format_ident!("default_{}", self.name())
    }
}

fn of_table(name: &Ident, fields: &mut Fields) -> Result<TokenStream> {
    let Fields::Named(fields) = fields else {
        return Err(Error::new(name.span(), "the keys of a table have names"));
    };
    let mut entries = Vec::new();
    for field in &mut fields.named {
        let key = KeyDeclaration::take_from(field)?;
        let entry = Entry { field: field.clone(), key };
        if entry.key.default.is_some() {
            let path = format!("{name}::{}", entry.default_function());
            field.attrs.push(parse_quote!(#[serde(default = #path)]));
        }
        entries.push(entry);
    }
    let (defaults, constructor) = (defaults(name, &entries), constructor(name, &entries));
    let keys = entries.iter().map(|entry| entry.key.constant(name, &entry.field, &entry.default_function()));
    let names = entries.iter().map(Entry::name);
    Ok(quote! {
        #defaults
        #constructor
        impl crate::keys::Table for #name {
            fn keys() -> &'static [crate::keys::Key] {
                const KEYS: &[crate::keys::Key] = &[#(#keys),*];
                KEYS
            }

            fn values(&self) -> Vec<&dyn crate::keys::Value> {
                vec![#(&self.#names),*]
            }
        }
    })
}

/// A function for each default: what serde calls for a key that is not there.
fn defaults(name: &Ident, entries: &[Entry]) -> TokenStream {
    let functions = entries.iter().filter_map(|entry| {
        let (function, kind, value) =
            (entry.default_function(), &entry.field.ty, entry.key.default.as_ref()?);
        Some(quote!(fn #function() -> #kind { #value }))
    });
    quote!(impl #name { #(#functions)* })
}

/// `Default`, or a function of the required values.
fn constructor(name: &Ident, entries: &[Entry]) -> TokenStream {
    let (given, others): (Vec<&Entry>, Vec<&Entry>) =
        entries.iter().partition(|entry| entry.key.default.is_none());
    let names: Vec<&Ident> = given.iter().map(|entry| entry.name()).collect();
    let types = given.iter().map(|entry| &entry.field.ty);
    let (fields, functions) = (others.iter().map(|e| e.name()), others.iter().map(|e| e.default_function()));
    let value = quote!(Self { #(#names,)* #(#fields: Self::#functions(),)* });
    if given.is_empty() {
        return quote!(impl Default for #name { fn default() -> Self { #value } });
    }
    quote! {
        impl #name {
            #[allow(dead_code, clippy::too_many_arguments, reason = "not every table is made so")]
            fn with_required(#(#names: #types),*) -> Self { #value }
        }
    }
}

fn of_words(name: &Ident) -> TokenStream {
    quote! {
        impl crate::keys::Value for #name {
            #[cfg(feature = "toml")]
            fn text(&self) -> String {
                crate::keys::text_of(self)
            }
        }
    }
}
