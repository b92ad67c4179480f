//
// Copyright (c) 2023 ZettaScale Technology
//
// This program and the accompanying materials are made available under the
// terms of the Eclipse Public License 2.0 which is available at
// http://www.eclipse.org/legal/epl-2.0, or the Apache License, Version 2.0
// which is available at https://www.apache.org/licenses/LICENSE-2.0.
//
// SPDX-License-Identifier: EPL-2.0 OR Apache-2.0
//
// Contributors:
//   ZettaScale Zenoh Team, <zenoh@zettascale.tech>
//
use alloc::string::String;

use zenoh_buffers::{
    reader::{DidntRead, Reader},
    writer::{DidntWrite, Writer},
};
use zenoh_protocol::{
    core::{key_expr::keyexpr, ExprId, ExprLen, WireExpr},
    network::Mapping,
};

use crate::{core::Zenoh080Bounded, RCodec, WCodec, Zenoh080, Zenoh080Condition};

impl<W> WCodec<&WireExpr<'_>, &mut W> for Zenoh080
where
    W: Writer,
{
    type Output = Result<(), DidntWrite>;

    #[inline(always)]
    fn write(self, writer: &mut W, x: &WireExpr<'_>) -> Self::Output {
        let WireExpr {
            scope,
            suffix,
            mapping: _,
        } = x;

        let zodec = Zenoh080Bounded::<ExprId>::new();
        zodec.write(&mut *writer, *scope)?;

        if x.has_suffix() {
            #[cold]
            fn write_suffix<W: Writer>(writer: &mut W, suffix: &str) -> Result<(), DidntWrite> {
                let zodec = Zenoh080Bounded::<ExprLen>::new();
                zodec.write(&mut *writer, suffix)
            }
            write_suffix(writer, suffix)?;
        }
        Ok(())
    }
}

impl<R> RCodec<WireExpr<'static>, &mut R> for Zenoh080Condition
where
    R: Reader,
{
    type Error = DidntRead;

    #[inline(always)]
    fn read(self, reader: &mut R) -> Result<WireExpr<'static>, Self::Error> {
        let zodec = Zenoh080Bounded::<ExprId>::new();
        let scope: ExprId = zodec.read(&mut *reader)?;

        let suffix: String = if self.condition {
            #[cold]
            fn read_suffix<R: Reader>(reader: &mut R) -> Result<String, DidntRead> {
                let zodec = Zenoh080Bounded::<ExprLen>::new();
                zodec.read(&mut *reader)
            }
            read_suffix(reader)?
        } else {
            String::new()
        };
        // PLUMBLINE: what is no key expression panics in the routing tables later, with their locks held.
        if !is_suffix_valid(scope, &suffix) {
            return Err(DidntRead);
        }
        Ok(WireExpr {
            scope,
            suffix: suffix.into(),
            mapping: Mapping::DEFAULT,
        })
    }
}

/// PLUMBLINE: whether what follows the expression `scope` is well formed: nothing, or after 0 (no expression) a whole key
/// expression, and after any other chunks of one. An expression that is only complete in the middle of a chunk is refused,
/// since this codec does not know the expression before it.
fn is_suffix_valid(scope: ExprId, suffix: &str) -> bool {
    let chunks = match scope {
        0 => Some(suffix),
        _ => suffix.strip_prefix('/'),
    };
    suffix.is_empty() || chunks.is_some_and(|chunks| keyexpr::new(chunks).is_ok())
}
