//! `#[derive(Record)]`: the fields of a record, and the names of an enumeration, as `plumbline-fields` has them.

use crate::key::{comment, tokens};
use proc_macro2::{Ident, TokenStream};
use quote::{ToTokens as _, quote};
use syn::parse::{ParseStream, Parser as _};
use syn::{
    Attribute, Data, DataEnum, DeriveInput, Error, Field, Fields, LitInt, LitStr, Meta, Result, Token,
};

/// The implementation for a struct or an enumeration.
pub fn of(input: &DeriveInput) -> Result<TokenStream> {
    let list = input.attrs.iter().find_map(|attribute| list(attribute, "record"));
    let list = list.ok_or_else(|| Error::new_spanned(&input.ident, "a record says #[record(\"NAME\")]"))?;
    match &input.data {
        Data::Struct(data) => of_struct(input, &data.fields, list),
        Data::Enum(data) => of_enum(&input.ident, data, list),
        Data::Union(_) => Err(Error::new_spanned(&input.ident, "a record is a struct or an enumeration")),
    }
}

/// Content of the attribute, if it has this name.
fn list<'a>(attribute: &'a Attribute, name: &str) -> Option<&'a TokenStream> {
    match &attribute.meta {
        Meta::List(list) if list.path.is_ident(name) => Some(&list.tokens),
        _ => None,
    }
}

fn of_struct(input: &DeriveInput, fields: &Fields, list: &TokenStream) -> Result<TokenStream> {
    let read = |input: ParseStream<'_>| -> Result<(LitStr, TokenStream)> {
        let name = input.parse()?;
        input.parse::<Option<Token![,]>>()?;
        Ok((name, input.parse()?))
    };
    let (name, more) = read.parse2(list.clone())?;
    let mut all = Vec::new();
    for field in fields {
        let lists: Vec<_> =
            field.attrs.iter().filter_map(|attribute| self::list(attribute, "field")).collect();
        if lists.is_empty() {
            return Err(Error::new_spanned(
                &field.ident,
                "a field says #[field(NUMBER, ...)] or #[field(none)]",
            ));
        }
        for list in lists.into_iter().filter(|list| list.to_string() != "none") {
            all.push((|input: ParseStream<'_>| row(field, input)).parse2(list.clone())?);
        }
    }
    let (kind, about) = (&input.ident, comment(&input.attrs));
    Ok(quote! {
        impl ::plumbline_fields::Record for #kind {
            const NAME: &'static str = #name;
            const ABOUT: &'static str = #about;
            const FIELDS: &'static [::plumbline_fields::Field<Self>] = &[#(#all,)* #more];
        }
    })
}

/// A field by its number and by what else `#[field(...)]` says.
fn row(field: &Field, input: ParseStream<'_>) -> Result<TokenStream> {
    let tag: LitInt = input.parse()?;
    let ident =
        field.ident.as_ref().ok_or_else(|| Error::new_spanned(field, "fields of a record have names"))?;
    let (mut place, mut name, mut about) =
        (quote!(#ident), ident.clone(), comment(&field.attrs).to_token_stream());
    let (mut wire, mut second, mut readers) = (None, None, TokenStream::new());
    while input.parse::<Option<Token![,]>>()?.is_some() && !input.is_empty() {
        let key: Ident = input.parse()?;
        let value: TokenStream = match input.parse::<Option<Token![=]>>()? {
            Some(_) => tokens(input)?.into_iter().collect(),
            None => TokenStream::new(),
        };
        match key.to_string().as_str() {
            "wire" => wire = Some(value),
            "about" => about = value,
            "pair" => second = Some(value),
            "path" => {
                name = syn::parse2(value)?;
                (place, about) = (quote!(#ident.#name), quote!(""));
            }
            _ => readers.extend(quote!(.#key(#value))),
        }
    }
    let name = name.to_string();
    let wire = wire.unwrap_or_else(|| name.to_token_stream());
    let facts = quote!((#tag, #name, #wire, #about));
    Ok(match second {
        Some(second) => quote! {
            ::plumbline_fields::Field::<Self>::new(
                #facts,
                ::plumbline_fields::Shape::Floats,
                |o| ::plumbline_fields::Value::Floats([
                    ::core::slice::from_ref(&o.#place), ::core::slice::from_ref(&o.#second),
                ]),
                |o, value| ::plumbline_fields::set_pair(&mut o.#place, &mut o.#second, value),
            )#readers
        },
        None => quote! {
            ::plumbline_fields::Field::<Self>::new(
                #facts,
                ::plumbline_fields::shape_of(|o: &Self| &o.#place),
                |o| ::plumbline_fields::FieldContent::get(&o.#place),
                |o, value| ::plumbline_fields::FieldContent::set(&mut o.#place, value),
            )
            .opened(
                |o| ::plumbline_fields::FieldContent::open(&mut o.#place),
                |o| ::plumbline_fields::FieldContent::begin(&mut o.#place),
            )#readers
        },
    })
}

fn of_enum(kind: &Ident, data: &DataEnum, list: &TokenStream) -> Result<TokenStream> {
    let read = |input: ParseStream<'_>| -> Result<(LitStr, LitStr)> {
        let name = input.parse()?;
        input.parse::<Token![,]>()?;
        Ok((name, input.parse()?))
    };
    let (name, otherwise) = read.parse2(list.clone())?;
    let prefix = name.value().rsplit('.').next().unwrap_or_default().to_uppercase();
    let variants = data.variants.iter().map(|variant| &variant.ident);
    let names = data.variants.iter().map(|variant| format!("{prefix}_{}", upper(&variant.ident.to_string())));
    let abouts = data.variants.iter().map(|variant| comment(&variant.attrs));
    let unspecified = format!("{prefix}_UNSPECIFIED");
    Ok(quote! {
        impl ::plumbline_fields::FieldContent for #kind {
            const SHAPE: ::plumbline_fields::Shape = {
                static ABOUT: ::plumbline_fields::Enumeration = ::plumbline_fields::Enumeration {
                    name: #name,
                    first: 1,
                    names: &[#unspecified, #(#names),*],
                    about: &["", #(#abouts),*],
                };
                ::plumbline_fields::Shape::Enumerator(&ABOUT)
            };

            fn get(&self) -> ::plumbline_fields::Value<'_> {
                ::plumbline_fields::Value::Whole(*self as i64)
            }

            fn set(&mut self, value: ::plumbline_fields::Value<'_>) -> Result<(), &'static str> {
                let ::plumbline_fields::Value::Whole(place) = value else { return Err(#otherwise) };
                *self = *[#(Self::#variants),*].iter().find(|one| **one as i64 == place).ok_or(#otherwise)?;
                Ok(())
            }
        }
    })
}

/// `NoPose` as `NO_POSE`.
fn upper(name: &str) -> String {
    let mut upper = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !upper.is_empty() {
            upper.push('_');
        }
        upper.extend(letter.to_uppercase());
    }
    upper
}
