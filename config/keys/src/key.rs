//! Contents of `#[key(...)]`.

use proc_macro2::{Ident, Literal, Span, TokenStream, TokenTree};
use quote::quote;
use syn::parse::{ParseStream, Parser as _};
use syn::{Attribute, Error, Expr, Field, Lit, Meta, Result, Token};

/// The declaration of a key.
#[derive(Default)]
pub struct KeyDeclaration {
    pub default: Option<TokenStream>,
    range: Option<[TokenStream; 2]>,
    unit: Option<TokenStream>,
    cure: Option<TokenStream>,
    is_experiment: bool,
    text: String,
}

impl KeyDeclaration {
    /// The key of a field, whose attribute is taken off.
    pub fn take_from(field: &mut Field) -> Result<Self> {
        let name = field.ident.clone();
        let at = field.attrs.iter().position(|attribute| attribute.path().is_ident("key"));
        let Some(at) = at else {
            return Err(Error::new_spanned(
                name,
                "a key says #[key(...)]: default, range, unit, cure, experiment",
            ));
        };
        let attribute = field.attrs.remove(at);
        let mut key = Self { text: comment(&field.attrs), ..Self::default() };
        if let Meta::List(list) = &attribute.meta {
            let mut read = |input: ParseStream<'_>| key.read(input);
            (|input: ParseStream<'_>| read(input)).parse2(list.tokens.clone())?;
        }
        Ok(key)
    }

    fn read(&mut self, input: ParseStream<'_>) -> Result<()> {
        while !input.is_empty() {
            let name: Ident = input.parse()?;
            let value = match input.parse::<Option<Token![=]>>()? {
                Some(_) => tokens(input)?,
                None => Vec::new(),
            };
            match (name.to_string().as_str(), value.is_empty()) {
                ("default", true) => self.default = Some(quote!(::core::default::Default::default())),
                ("default", false) => self.default = Some(owned(value)),
                ("range", false) => self.range = Some(ends(value, name.span())?),
                ("unit", false) => self.unit = Some(value.into_iter().collect()),
                ("cure", false) => self.cure = Some(value.into_iter().collect()),
                ("experiment", true) => self.is_experiment = true,
                _ => return Err(Error::new(name.span(), "a key has default, range, unit, cure, experiment")),
            }
            input.parse::<Option<Token![,]>>()?;
        }
        Ok(())
    }

    /// The constant `crate::keys::Key` of a field.
    pub fn constant(&self, table: &Ident, field: &Field, default_function: &Ident) -> TokenStream {
        let (name, text, kind) = (field.ident.as_ref().map(Ident::to_string), &self.text, &field.ty);
        let is_experiment = self.is_experiment;
        let default = self.default.as_ref().map_or(
            quote!(None),
            |_| quote!(Some(|| crate::keys::Value::text(&#table::#default_function()))),
        );
        let range =
            self.range.as_ref().map_or(quote!(None), |[low, high]| quote!(Some((#low as f64, #high as f64))));
        let unit = self.unit.as_ref().map_or(quote!(None), |unit| quote!(Some(crate::keys::#unit)));
        let cure = self.cure.as_ref().map_or(quote!(None), |cure| quote!(Some(#cure)));
        quote! {
            crate::keys::Key {
                name: #name,
                text: #text,
                kind: <#kind as crate::keys::Value>::kind,
                #[cfg(feature = "toml")]
                default: #default,
                range: #range,
                unit: #unit,
                cure: #cure,
                is_experiment: #is_experiment,
            }
        }
    }
}

/// The lines of a doc comment, one paragraph a line.
pub fn comment(attributes: &[Attribute]) -> String {
    let lines =
        attributes.iter().filter(|attribute| attribute.path().is_ident("doc")).filter_map(|attribute| {
            let Meta::NameValue(doc) = &attribute.meta else { return None };
            let Expr::Lit(literal) = &doc.value else { return None };
            let Lit::Str(line) = &literal.lit else { return None };
            Some(line.value().trim().to_owned())
        });
    lines.collect::<Vec<_>>().join(" ")
}

/// Tokens before the next comma.
pub fn tokens(input: ParseStream<'_>) -> Result<Vec<TokenTree>> {
    let mut found = Vec::new();
    while !input.is_empty() && !input.peek(Token![,]) {
        found.push(input.parse()?);
    }
    Ok(found)
}

/// A default; of a text in its owned form.
fn owned(value: Vec<TokenTree>) -> TokenStream {
    let is_text = |literal: &Literal| literal.to_string().starts_with('"');
    match &value[..] {
        [TokenTree::Literal(literal)] if is_text(literal) => quote!(#literal.into()),
        _ => value.into_iter().collect(),
    }
}

/// Both ends of `LOW..=HIGH`.
fn ends(value: Vec<TokenTree>, span: Span) -> Result<[TokenStream; 2]> {
    let is_point =
        |token: &TokenTree, point: char| matches!(token, TokenTree::Punct(p) if p.as_char() == point);
    let is_range =
        |tokens: &[TokenTree]| tokens.iter().zip("..=".chars()).all(|(token, point)| is_point(token, point));
    let at = value.windows(3).position(is_range);
    let at = at.ok_or_else(|| Error::new(span, "a range is LOW..=HIGH"))?;
    let side = |tokens: &[TokenTree]| tokens.iter().cloned().collect();
    Ok([side(&value[..at]), side(&value[at + 3..])])
}
