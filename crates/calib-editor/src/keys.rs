//! Keys and modifier keys of commands and tools.

/// Modifier keys that are pressed together with a key or a pointer button.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Modifiers {
    /// Whether Shift is pressed.
    pub shift: bool,
    /// Whether Ctrl is pressed, on every system.
    pub ctrl: bool,
    /// Whether Alt is pressed.
    pub alt: bool,
    /// Whether Ctrl is pressed, or Cmd on a Mac.
    pub command: bool,
}

impl Modifiers {
    /// No modifier key.
    pub const NONE: Self = Self { shift: false, ctrl: false, alt: false, command: false };
    /// Shift only.
    pub const SHIFT: Self = Self { shift: true, ..Self::NONE };
    /// Alt only.
    pub const ALT: Self = Self { alt: true, ..Self::NONE };
    /// Ctrl only, or Cmd on a Mac.
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
            /// Returns the name of the key in keyboard events of browsers.
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

/// Keyboard shortcut: a key with modifier keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shortcut {
    /// Modifier keys that must be pressed.
    pub modifiers: Modifiers,
    /// Key that is pressed last.
    pub key: Key,
}
