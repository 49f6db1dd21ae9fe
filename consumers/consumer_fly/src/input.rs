//! What keys and mouse ask for, whatever they come from.

/// A key that acts for as long as it is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Held {
    /// Along the view.
    Forward,
    /// Against the view.
    Back,
    /// Aside.
    Left,
    /// Aside.
    Right,
    /// Up in the world.
    Up,
    /// Down in the world.
    Down,
    /// Faster.
    Fast,
    /// Look to the left.
    TurnLeft,
    /// Look to the right.
    TurnRight,
    /// Look up.
    LookUp,
    /// Look down.
    LookDown,
}

/// One thing that keys or mouse ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Input {
    /// A key goes down or up.
    Hold(Held, bool),
    /// All keys are up: the window lost the keyboard.
    ReleaseAll,
    /// The mouse was dragged: by so much to the left and down, radians.
    Turn {
        /// Leftwards.
        yaw_rad: f64,
        /// Downwards.
        pitch_rad: f64,
    },
    /// The wheel turned by so many notches, away from the user.
    Wheel(f64),
    /// Follow the next actor, or with `false` the one before.
    Follow {
        /// Whether the next.
        next: bool,
    },
    /// Follow this actor.
    FollowActor(u32),
    /// Fly freely.
    Free,
    /// Look from above, or no longer.
    Top,
    /// End.
    Close,
}

/// What a letter key asks for, whether held or hit; `None` for letters without a meaning. Capital
/// letters are the same keys.
pub fn of_letter(letter: char, down: bool) -> Option<Input> {
    let held = match letter.to_ascii_lowercase() {
        'w' => Held::Forward,
        's' => Held::Back,
        'a' => Held::Left,
        'd' => Held::Right,
        'q' => Held::Up,
        'e' => Held::Down,
        other => return of_hit(other).filter(|_| down),
    };
    Some(Input::Hold(held, down))
}

fn of_hit(letter: char) -> Option<Input> {
    Some(match letter {
        'n' => Input::Follow { next: true },
        'p' => Input::Follow { next: false },
        'f' => Input::Free,
        't' => Input::Top,
        'x' => Input::Close,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_held_or_hit() {
        assert_eq!(of_letter('W', true), Some(Input::Hold(Held::Forward, true)));
        assert_eq!(
            of_letter('w', false),
            Some(Input::Hold(Held::Forward, false))
        );
        assert_eq!(of_letter('n', true), Some(Input::Follow { next: true }));
        assert_eq!(of_letter('n', false), None, "only going down counts");
        assert_eq!(of_letter('ö', true), None);
    }
}
