//! Lists that end being read when they are longer than any that is meant: a hostile file does not fill memory first.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error as _, SeqAccess, Visitor};

/// Most annotations, control points, links, marks or points in one list.
pub const MAX_ITEMS: usize = 100_000;
/// Most cameras in a site.
pub const MAX_CAMERAS: usize = 10_000;

/// A list of anything that is drawn.
pub(crate) fn items<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Vec<T>, D::Error> {
    from.deserialize_seq(Bounded { most: MAX_ITEMS, of: PhantomData })
}

/// The list of cameras.
pub(crate) fn cameras<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Vec<T>, D::Error> {
    from.deserialize_seq(Bounded { most: MAX_CAMERAS, of: PhantomData })
}

struct Bounded<T> {
    most: usize,
    of: PhantomData<T>,
}

impl<'de, T: Deserialize<'de>> Visitor<'de> for Bounded<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of at most {}", self.most)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<T>, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = list.next_element()? {
            if items.len() == self.most {
                let most = self.most;
                return Err(A::Error::custom(format!(
                    "found more than {most} items, expected at most {most}"
                )));
            }
            items.push(item);
        }
        Ok(items)
    }
}
