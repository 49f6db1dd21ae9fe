//! Colours of the screen, or none.

use ratatui::style::{Color, Modifier, Style as Look};

/// How things look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style {
    /// Whether there are colours.
    pub coloured: bool,
}

impl Style {
    fn look(self, colour: Color) -> Look {
        match self.coloured {
            true => Look::new().fg(colour),
            false => Look::new(),
        }
    }

    /// Titles and notices.
    pub fn title(self) -> Look {
        self.look(Color::Cyan).add_modifier(Modifier::BOLD)
    }

    /// Heads of tables.
    pub fn head(self) -> Look {
        Look::new().add_modifier(Modifier::BOLD)
    }

    /// What matters less.
    pub fn dim(self) -> Look {
        Look::new().add_modifier(Modifier::DIM)
    }

    /// What needs a look: losses, stopped processes, full places.
    pub fn alarm(self) -> Look {
        self.look(Color::Red).add_modifier(Modifier::BOLD)
    }

    /// Topics of the simulator's sensors.
    pub fn frames(self) -> Look {
        self.look(Color::Green)
    }

    /// Topics of users' programs.
    pub fn results(self) -> Look {
        self.look(Color::Yellow)
    }

    /// Topics to the simulator.
    pub fn controls(self) -> Look {
        self.look(Color::Magenta)
    }

    /// The selected row.
    pub fn selected(self) -> Look {
        Look::new().add_modifier(Modifier::REVERSED)
    }

    /// The frame of the table that the keys move in.
    pub fn active(self) -> Look {
        self.look(Color::Cyan)
    }
}
