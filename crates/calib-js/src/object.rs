//! Plain objects and typed arrays of JavaScript.

use js_sys::{Array, Float64Array, Object, Reflect};
use wasm_bindgen::prelude::*;

/// A plain object.
pub(crate) fn object<T: JsCast>(fields: &[(&str, JsValue)]) -> T {
    let object = Object::new();
    set(&object, fields.iter().cloned());
    object.unchecked_into()
}

pub(crate) fn set<'a>(object: &JsValue, fields: impl Iterator<Item = (&'a str, JsValue)>) {
    for (key, value) in fields {
        // Setting a field of a new object cannot fail.
        let _ = Reflect::set(object, &key.into(), &value);
    }
}

/// A typed array.
pub(crate) fn doubles(values: &[f64]) -> JsValue {
    Float64Array::from(values).into()
}

/// A tuple of numbers.
pub(crate) fn tuple(values: &[f64]) -> JsValue {
    values.iter().copied().map(JsValue::from).collect::<Array>().into()
}

/// A list of so many numbers.
pub(crate) fn numbers<const N: usize>(value: &JsValue) -> Option<[f64; N]> {
    let list = Array::is_array(value).then(|| Array::from(value))?;
    list.iter().map(|one| one.as_f64()).collect::<Option<Vec<f64>>>()?.try_into().ok()
}

/// The fields of an object that are set, by name.
pub(crate) fn fields(of: &JsValue) -> impl Iterator<Item = (String, JsValue)> {
    let object: Object = of.clone().unchecked_into();
    Object::keys(&object).to_vec().into_iter().filter_map(move |key| {
        let value = Reflect::get(&object, &key).unwrap_or(JsValue::UNDEFINED);
        (!value.is_undefined()).then(|| (key.as_string().unwrap_or_default(), value))
    })
}
