//! Keys and modifiers, as used by the commands and tools.

/// Modifier keys that are pressed together with a key or a pointer button.
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
    /// No modifier.
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
        /// Key that runs a command or selects a tool.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[expect(missing_docs, reason = "the names equal the key names")]
        pub enum Key { $($name),* }

        impl Key {
            /// Returns its name in keyboard events of browsers.
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

/// Key with its modifiers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shortcut {
    /// Modifier keys.
    pub modifiers: Modifiers,
    /// The key.
    pub key: Key,
}
