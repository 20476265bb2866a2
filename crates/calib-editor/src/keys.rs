//! Keys and what is held with them, as the document's commands and tools name them.

/// The keys held with a press, of the pointer or of another key.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Modifiers {
    /// Shift.
    pub shift: bool,
    /// Ctrl, on every system.
    pub ctrl: bool,
    /// Alt.
    pub alt: bool,
    /// Ctrl, or Cmd on a Mac.
    pub command: bool,
}

impl Modifiers {
    /// None held.
    pub const NONE: Self = Self { shift: false, ctrl: false, alt: false, command: false };
    /// Shift.
    pub const SHIFT: Self = Self { shift: true, ..Self::NONE };
    /// Alt.
    pub const ALT: Self = Self { alt: true, ..Self::NONE };
    /// Ctrl, or Cmd on a Mac.
    pub const COMMAND: Self = Self { command: true, ..Self::NONE };
    /// Ctrl and Shift, or Cmd and Shift on a Mac.
    pub const COMMAND_SHIFT: Self = Self { shift: true, ..Self::COMMAND };
}

macro_rules! keys {
    ($($name:ident $word:literal),* $(,)?) => {
        /// A key that gives a command or takes a tool.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[expect(missing_docs, reason = "a key is what its name says")]
        pub enum Key { $($name),* }

        impl Key {
            /// Its name, as keyboards and browsers have it.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => $word),* }
            }
        }
    };
}

keys! {
    A "A", B "B", C "C", D "D", E "E", F "F", G "G", H "H", I "I", J "J", K "K", L "L", M "M", N "N", O "O",
    P "P", Q "Q", R "R", S "S", T "T", U "U", V "V", W "W", X "X", Y "Y", Z "Z",
    Num1 "1", Num2 "2", Num3 "3", Num4 "4", F8 "F8", F9 "F9",
    ArrowDown "ArrowDown", ArrowLeft "ArrowLeft", ArrowRight "ArrowRight", ArrowUp "ArrowUp",
    Backspace "Backspace", Delete "Delete", Enter "Enter", Escape "Escape", Home "Home",
    CloseBracket "]", Minus "Minus", OpenBracket "[", Plus "Plus", Questionmark "?",
}

/// A key with what is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shortcut {
    /// What is held.
    pub modifiers: Modifiers,
    /// The key.
    pub key: Key,
}
