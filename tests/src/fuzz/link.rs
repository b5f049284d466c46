//! The link's decoder: any bytes, then a message.

use splash_firmware::link::{Message, Receiver, Request, Response, WIRE, encode};

/// What is read can be sent again and is the same; after any garbage, and one 0x00, the next message
/// arrives.
pub(super) fn run(bytes: &[u8]) {
    check::<Request>(bytes, Request::Identify);
    check::<Response>(bytes, Response::Ready);
}

fn check<T>(bytes: &[u8], last: T)
where
    T: serde::Serialize + serde::de::DeserializeOwned + PartialEq + std::fmt::Debug + Clone,
{
    let mut receiver = Receiver::new();
    let mut wire = [0; WIRE];
    for &byte in bytes {
        let Some(Ok(message)) = receiver.push::<T>(byte) else { continue };
        let sent = encode(&message, &mut wire).expect("what fitted once fits again");
        assert_eq!(
            arrives::<T>(&mut Receiver::new(), sent).as_ref().map(same),
            Some(same(&message))
        );
    }
    let _ = receiver.push::<T>(0);
    let message = Message { sequence: 0x1234, body: last };
    let sent = encode(&message, &mut wire).expect("short");
    assert_eq!(arrives(&mut receiver, sent), Some(message), "in step again");
}

/// The last message in these bytes.
fn arrives<T: serde::de::DeserializeOwned>(
    receiver: &mut Receiver,
    bytes: &[u8],
) -> Option<Message<T>> {
    bytes.iter().filter_map(|&byte| receiver.push(byte)).filter_map(Result::ok).last()
}

/// Equal for equal messages, numbers that are none included.
fn same<T: std::fmt::Debug>(message: &Message<T>) -> String {
    format!("{message:?}")
}
