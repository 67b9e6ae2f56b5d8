//! The wire format of Protocol Buffers, as much of it as events need.
//!
//! A message is a series of fields, each a tag (number and wire type) and a value. Fields are written where their value is
//! the default one, too; readers take them the same.

/// A message under construction; fields stand in the order of the calls.
#[derive(Clone, Debug, Default)]
pub(crate) struct Message(Vec<u8>);

/// How a value is laid out.
#[derive(Clone, Copy)]
enum Wire {
    Varint = 0,
    Fixed64 = 1,
    Bytes = 2,
    Fixed32 = 5,
}

impl Message {
    /// One without fields.
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// Its bytes, without a length before them.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// An `int32`, `int64`, `uint64`, `bool` or an enum's number; never negative here.
    pub(crate) fn int(self, field: u32, value: u64) -> Self {
        self.tag(field, Wire::Varint).varint(value)
    }

    /// A `double`.
    pub(crate) fn double(self, field: u32, value: f64) -> Self {
        self.tag(field, Wire::Fixed64).raw(&value.to_le_bytes())
    }

    /// A `float`.
    pub(crate) fn float(self, field: u32, value: f32) -> Self {
        self.tag(field, Wire::Fixed32).raw(&value.to_le_bytes())
    }

    /// A `string`.
    pub(crate) fn text(self, field: u32, value: &str) -> Self {
        self.length_delimited(field, value.as_bytes())
    }

    /// A message within this one, or one more of a repeated field; a `bytes` field that holds a message is the same.
    pub(crate) fn message(self, field: u32, value: &Message) -> Self {
        self.length_delimited(field, &value.0)
    }

    /// A packed `repeated double`.
    pub(crate) fn doubles(self, field: u32, values: impl IntoIterator<Item = f64>) -> Self {
        let packed: Vec<u8> = values.into_iter().flat_map(f64::to_le_bytes).collect();
        self.length_delimited(field, &packed)
    }

    fn length_delimited(self, field: u32, value: &[u8]) -> Self {
        self.tag(field, Wire::Bytes).varint(value.len() as u64).raw(value)
    }

    fn tag(self, field: u32, wire: Wire) -> Self {
        self.varint(u64::from(field << 3 | wire as u32))
    }

    /// Seven bits a byte, the lowest first; the top bit says that more follow.
    fn varint(mut self, mut value: u64) -> Self {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
        self
    }

    fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of Protocol Buffers' "Encoding" page.
    #[test]
    fn fields_are_encoded_as_documented() {
        assert_eq!(Message::new().int(1, 150).bytes(), [0x08, 0x96, 0x01]);
        assert_eq!(Message::new().text(2, "testing").bytes(), b"\x12\x07testing");
        assert_eq!(Message::new().message(3, &Message::new().int(1, 150)).bytes(), [0x1a, 0x03, 0x08, 0x96, 0x01]);
    }

    #[test]
    fn numbers_take_their_width() {
        assert_eq!(Message::new().float(2, 1.0).bytes(), [0x15, 0, 0, 0x80, 0x3f]);
        assert_eq!(Message::new().double(1, 1.0).bytes(), [0x09, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f]);
        assert_eq!(Message::new().int(1, u64::MAX).bytes(), [8, 255, 255, 255, 255, 255, 255, 255, 255, 255, 1]);
        assert_eq!(Message::new().doubles(6, []).bytes(), [0x32, 0]);
    }
}
