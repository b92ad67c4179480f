//! Records as JSON, by the names of their fields.

use plumbline_link::net::plain;
use plumbline_record::fields::{About, Parts, Shape, Value as Field};
use serde_json::Value;

/// Fields of a record by their names.
pub fn fields(record: &dyn Parts) -> Value {
    let mut all = serde_json::Map::new();
    record.visit(&mut |about, value| _ = all.insert(about.wire.to_owned(), field(about, value)));
    Value::Object(all)
}

fn field(about: &About, value: Field<'_>) -> Value {
    match (value, about.shape) {
        (Field::Whole(number), Shape::Flag) => (number != 0).into(),
        (Field::Whole(number), Shape::Enumerator(of)) => {
            let place = usize::try_from(number + of.first).unwrap_or(0);
            of.names.get(place).copied().unwrap_or_default().into()
        }
        (Field::Whole(number), Shape::Uint64) => (number as u64).into(),
        (Field::Whole(number), _) => number.into(),
        (Field::Floats([[number], []]), _) => (*number).into(),
        (Field::Floats([first, second]), _) => [first, second].concat().into(),
        (Field::Singles(numbers), _) => numbers.into(),
        (Field::Text(text), _) => plain(text).into(),
        (Field::Part(part), _) => fields(part),
        (Field::Items(items), _) => (0..items.count()).map(|at| field(about, items.item(at))).collect(),
        (Field::Bytes(_) | Field::Missing, _) => Value::Null,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_estimator::Odometry;
    use serde_json::json;

    #[test]
    fn a_record_without_a_place_of_its_own_is_told_by_its_fields() {
        let told = fields(&Odometry { quality: -1, ..Odometry::default() });
        assert_eq!((told["quality"].as_i64(), &told["state"]), (Some(-1), &json!("STATE_INITIALISING")));
        assert_eq!(told["pose_o_b"].as_array().map(Vec::len), Some(7));
    }
}
