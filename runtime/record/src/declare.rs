//! Lists of a record's fields: `record!` for types of other crates, `message!` for a type that it defines besides.

/// A field by its path from the record; two numbers that are one field by both names.
macro_rules! field {
    (($tag:literal, $name:expr, $wire:expr, $about:expr), $first:ident & $second:ident) => {
        $crate::fields::Field::<Self>::new(
            ($tag, $name, $wire, $about),
            $crate::fields::Shape::Floats,
            |o| $crate::fields::Value::Floats([std::slice::from_ref(&o.$first), std::slice::from_ref(&o.$second)]),
            |o, value| $crate::fields::set_pair(&mut o.$first, &mut o.$second, value),
        )
    };
    (($tag:literal, $name:expr, $wire:expr, $about:expr), $($path:ident).+) => {
        $crate::fields::Field::<Self>::new(
            ($tag, $name, $wire, $about),
            $crate::fields::shape_of(|o: &Self| &o.$($path).+),
            |o| $crate::fields::Part::get(&o.$($path).+),
            |o, value| $crate::fields::Part::set(&mut o.$($path).+, value),
        )
        .opened(|o| $crate::fields::Part::open(&mut o.$($path).+))
    };
}

/// The table of a type.
macro_rules! record {
    (
        $(#[doc = $said:literal])+
        $type:ty as $message:literal, blank $blank:expr;
        $(
            $(#[doc = $about:literal])*
            $tag:literal $first:ident $(& $second:ident)? as $wire:expr $(, [$($reader:tt)*])?;
        )*
        $(besides { $($besides:tt)+ };)?
        $(more $more:expr;)*
    ) => {
        impl $crate::fields::Record for $type {
            const NAME: &'static str = $message;
            const ABOUT: &'static str = concat!($($said),+).trim_ascii();
            const FIELDS: &'static [$crate::fields::Field<Self>] = &[
                $(field!(
                    ($tag, stringify!($first), $wire, concat!($($about),*).trim_ascii()), $first $(& $second)?
                ) $($($reader)*)?,)*
                $($more,)*
            ];

            fn blank() -> Self {
                // Every field is in the table, or left out on purpose.
                let _ = |Self { $($first: _, $($second: _,)?)* $($($besides)+)? }: &Self| ();
                $blank
            }
        }
    };
}

/// A type and its table: what a field is called in the program it is called in the schema.
macro_rules! message {
    (
        $(#[doc = $said:literal])+
        $type:ident as $message:literal;
        $(
            $(#[doc = $about:literal])+
            $tag:literal $field:ident: $of:ty $(, [$($reader:tt)*])?;
        )*
    ) => {
        $(#[doc = $said])+
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $type {
            $($(#[doc = $about])+ pub $field: $of,)*
        }

        record! {
            $(#[doc = $said])+
            $type as $message, blank Self::default();
            $($(#[doc = $about])+ $tag $field as stringify!($field) $(, [$($reader)*])?;)*
        }
    };
}
