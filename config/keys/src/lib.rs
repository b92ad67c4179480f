//! Declarations beside the field: keys of a configuration by the attribute `#[keys]`, and records by `#[derive(Record)]`.
//!
//! # Keys, for the crate `plumbline-config`
//!
//! ```text
//! /// Detection and tracking of points.
//! #[keys]
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
//! A struct becomes a table (`crate::keys::Table`) that serde reads and writes, in which unknown keys are refused. Its `Default` (`new`
//! of the values of required keys) is made of the defaults. An enum becomes a choice of words, which `#[keys(...)]` spells by a rule of
//! serde (`"lowercase"`); its variant for `#[default]` is that of the type. The comment of a field is the text of its key.
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
use syn::{Data, DeriveInput, Error, Fields, Ident, LitStr, Result, parse_macro_input, parse_quote};

/// Makes a struct a table of the configuration, and an enum a choice of words.
#[proc_macro_attribute]
pub fn keys(spelling: proc_macro::TokenStream, item: proc_macro::TokenStream) -> proc_macro::TokenStream {
    let mut input = parse_macro_input!(item as DeriveInput);
    let name = &input.ident;
    match &mut input.data {
        Data::Struct(data) => {
            let made = of_table(name, &mut data.fields).unwrap_or_else(Error::into_compile_error);
            quote! {
                #[derive(Clone, Debug, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
                #[serde(deny_unknown_fields)]
                #input
                #made
            }
        }
        _ => {
            let spelling = parse_macro_input!(spelling as LitStr);
            quote! {
                #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ::serde::Serialize, ::serde::Deserialize)]
                #[serde(rename_all = #spelling)]
                #input
                impl crate::keys::Value for #name {}
            }
        }
    }
    .into()
}

/// Makes a struct a record, and an enumeration a field of records.
#[proc_macro_derive(Record, attributes(record, field))]
pub fn record(item: proc_macro::TokenStream) -> proc_macro::TokenStream {
    let input = parse_macro_input!(item as DeriveInput);
    record::of(&input).unwrap_or_else(Error::into_compile_error).into()
}

fn of_table(name: &Ident, fields: &mut Fields) -> Result<TokenStream> {
    let (mut keys, mut names, mut values) = (Vec::new(), Vec::new(), Vec::new());
    // What serde calls for a key that is not there, and the values of keys that must be.
    let (mut functions, mut required) = (Vec::new(), Vec::new());
    for field in fields {
        let key = KeyDeclaration::take_from(field)?;
        let (ident, kind, function) = (&field.ident, &field.ty, format_ident!("default_{}", key.name));
        keys.push(key.constant(name, kind, &function));
        names.push(ident.clone());
        match &key.default {
            None => {
                required.push(quote!(#ident: #kind));
                values.push(quote!(#ident));
            }
            Some(value) => {
                functions.push(quote!(fn #function() -> #kind { #value }));
                values.push(quote!(#ident: Self::#function()));
                let path = format!("{name}::{function}");
                field.attrs.push(parse_quote!(#[serde(default = #path)]));
            }
        }
    }
    let value = quote!(Self { #(#values),* });
    let constructor = match required.is_empty() {
        true => quote!(impl Default for #name { fn default() -> Self { #value } }),
        false => quote! {
            impl #name {
                /// Values of the required keys, and the defaults for all else.
                pub fn new(#(#required),*) -> Self { #value }
            }
        },
    };
    Ok(quote! {
        impl #name { #(#functions)* }
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
