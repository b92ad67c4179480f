//! Contents of `#[key(...)]`.

use proc_macro2::{Ident, TokenStream, TokenTree};
use quote::quote;
use syn::parse::ParseStream;
use syn::{Attribute, Error, Expr, ExprLit, Field, Lit, Meta, Result, Token, Type};

/// The declaration of a key.
pub struct KeyDeclaration {
    pub name: String,
    pub default: Option<TokenStream>,
    /// Members of `crate::keys::Key` that are not those of a plain key.
    members: TokenStream,
    text: String,
}

impl KeyDeclaration {
    /// The key of a field, whose attribute is taken off.
    pub fn take_from(field: &mut Field) -> Result<Self> {
        const KNOWN: &str = "a key says #[key(...)]: default, range, unit, cure, experiment";
        let at = field.attrs.iter().position(|attribute| attribute.path().is_ident("key"));
        let at = at.ok_or_else(|| Error::new_spanned(&field.ident, KNOWN))?;
        let attribute = field.attrs.remove(at);
        let name = field.ident.as_ref().map(Ident::to_string).unwrap_or_default();
        let mut key = Self { name, default: None, members: TokenStream::new(), text: comment(&field.attrs) };
        let read = |input: ParseStream<'_>| {
            while !input.is_empty() {
                let name: Ident = input.parse()?;
                let has_value = input.parse::<Option<Token![=]>>()?.is_some();
                match (name.to_string().as_str(), has_value) {
                    ("default", true) => key.default = Some(owned(input.parse()?)),
                    ("default", false) => key.default = Some(quote!(::core::default::Default::default())),
                    ("range", true) => {
                        let mut low = TokenStream::new();
                        while !input.peek(Token![..=]) {
                            low.extend([input.parse::<TokenTree>()?]);
                        }
                        input.parse::<Token![..=]>()?;
                        let high: Expr = input.parse()?;
                        key.members.extend(quote!(range: Some((#low as f64, #high as f64)),));
                    }
                    ("unit", true) => {
                        let unit: Ident = input.parse()?;
                        key.members.extend(quote!(unit: Some(crate::keys::#unit),));
                    }
                    ("cure", true) => {
                        let cure: Expr = input.parse()?;
                        key.members.extend(quote!(cure: Some(#cure),));
                    }
                    ("experiment", false) => key.members.extend(quote!(is_experiment: true,)),
                    _ => return Err(Error::new(name.span(), KNOWN)),
                }
                input.parse::<Option<Token![,]>>()?;
            }
            Ok(())
        };
        if matches!(attribute.meta, Meta::List(_)) {
            attribute.parse_args_with(read)?;
        }
        Ok(key)
    }

    /// The constant `crate::keys::Key` of a field of a table.
    pub fn constant(&self, table: &Ident, kind: &Type, default_function: &Ident) -> TokenStream {
        let Self { name, members, text, .. } = self;
        let default = self
            .default
            .as_ref()
            .map(|_| quote!(default: Some(|| crate::keys::Text::text(&#table::#default_function())),));
        quote! {
            crate::keys::Key { #default #members ..crate::keys::Key::of::<#kind>(#name, #text) }
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

/// A default; of a text in its owned form.
fn owned(value: Expr) -> TokenStream {
    match value {
        Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) => quote!(#text.into()),
        value => quote!(#value),
    }
}
