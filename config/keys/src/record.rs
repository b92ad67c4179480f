//! `#[derive(Record)]`: the fields of a record, and the names of an enumeration, as `plumbline-fields` has them.

use crate::key::comment;
use heck::ToShoutySnakeCase as _;
use proc_macro2::{Ident, TokenStream, TokenTree};
use quote::{ToTokens as _, quote};
use syn::parse::ParseStream;
use syn::{Attribute, Data, DataEnum, DeriveInput, Error, Field, Fields, LitInt, LitStr, Result, Token};

/// The implementation for a struct or an enumeration.
pub fn of(input: &DeriveInput) -> Result<TokenStream> {
    let list = input.attrs.iter().find(|attribute| attribute.path().is_ident("record"));
    let list = list.ok_or_else(|| Error::new_spanned(&input.ident, "a record says #[record(\"NAME\")]"))?;
    match &input.data {
        Data::Struct(data) => of_struct(input, &data.fields, list),
        Data::Enum(data) => of_enum(&input.ident, data, list),
        Data::Union(_) => Err(Error::new_spanned(&input.ident, "a record is a struct or an enumeration")),
    }
}

fn of_struct(input: &DeriveInput, fields: &Fields, list: &Attribute) -> Result<TokenStream> {
    let (name, more) = list.parse_args_with(|input: ParseStream<'_>| -> Result<(LitStr, TokenStream)> {
        let name = input.parse()?;
        input.parse::<Option<Token![,]>>()?;
        Ok((name, input.parse()?))
    })?;
    let mut all = Vec::new();
    for field in fields {
        let mut lists = field.attrs.iter().filter(|attribute| attribute.path().is_ident("field")).peekable();
        if lists.peek().is_none() {
            let cure = "a field says #[field(NUMBER, ...)] or #[field(none)]";
            return Err(Error::new_spanned(&field.ident, cure));
        }
        for list in lists.filter(|list| !list.parse_args::<Ident>().is_ok_and(|word| word == "none")) {
            all.push(list.parse_args_with(|input: ParseStream<'_>| row(field, input))?);
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
    let (mut wire, mut second, mut facts) = (None, None, TokenStream::new());
    while input.parse::<Option<Token![,]>>()?.is_some() && !input.is_empty() {
        let key: Ident = input.parse()?;
        let value: TokenStream = match input.parse::<Option<Token![=]>>()? {
            Some(_) => tokens(input)?,
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
            "at" => facts.extend(quote!(field.about.at = Some(#value);)),
            "one" => facts.extend(quote!(field.about.shape = ::plumbline_fields::Shape::Double;)),
            "single" => facts.extend(quote!(field.about.shape = ::plumbline_fields::Shape::Singles;)),
            "digest_as" => facts.extend(quote!(field.get_for_digest = #value;)),
            _ => facts.extend(quote!(field.about.#key = #value;)),
        }
    }
    let name = name.to_string();
    let wire = wire.unwrap_or_else(|| name.to_token_stream());
    let functions = match second {
        Some(second) => quote! {
            ::plumbline_fields::Shape::Floats,
            |o| ::plumbline_fields::Value::Floats([
                ::core::slice::from_ref(&o.#place), ::core::slice::from_ref(&o.#second),
            ]),
            |o, value| ::plumbline_fields::set_pair(&mut o.#place, &mut o.#second, value)
        },
        None => {
            facts.extend(quote!(field.begin = |o| ::plumbline_fields::FieldContent::begin(&mut o.#place);));
            quote! {
                ::plumbline_fields::shape_of(|o: &Self| &o.#place),
                |o| ::plumbline_fields::FieldContent::get(&o.#place),
                |o, value| ::plumbline_fields::FieldContent::set(&mut o.#place, value)
            }
        }
    };
    Ok(quote! {{
        let mut field = ::plumbline_fields::Field::<Self>::new((#tag, #name, #wire, #about), #functions);
        #facts
        field
    }})
}

/// Tokens before the next comma.
fn tokens(input: ParseStream<'_>) -> Result<TokenStream> {
    let mut found = TokenStream::new();
    while !input.is_empty() && !input.peek(Token![,]) {
        found.extend(Some(input.parse::<TokenTree>()?));
    }
    Ok(found)
}

fn of_enum(kind: &Ident, data: &DataEnum, list: &Attribute) -> Result<TokenStream> {
    let (name, otherwise) = list.parse_args_with(|input: ParseStream<'_>| -> Result<(LitStr, LitStr)> {
        let name = input.parse()?;
        input.parse::<Token![,]>()?;
        Ok((name, input.parse()?))
    })?;
    let prefix = name.value().rsplit('.').next().unwrap_or_default().to_uppercase();
    let variants = data.variants.iter().map(|variant| &variant.ident);
    let names = data
        .variants
        .iter()
        .map(|variant| format!("{prefix}_{}", variant.ident.to_string().to_shouty_snake_case()));
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
