//! A window of the X11 server (or of XWayland), spoken to over its socket: no library is needed.

use anyhow::{Context as _, bail, ensure};
use x11rb::connection::{Connection as _, RequestConnection as _};
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    AtomEnum, ButtonPressEvent, ConfigureNotifyEvent, ConnectionExt as _, CreateGCAux,
    CreateWindowAux, EventMask, Gcontext, ImageFormat, ImageOrder, KeyPressEvent,
    MotionNotifyEvent, PropMode, Rectangle, Window as WindowId, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

use crate::input::{Held, Input, of_letter};
use crate::scale::{fit, scaled};
use crate::screen::{Picture, Screen};

/// Turn of the view per pixel that the mouse is dragged, radians.
const TURN_PER_PX: f64 = 0.003;
/// Size at first, pixels.
const FIRST_SIZE_PX: [u16; 2] = [1280, 720];
/// Longest jump of the mouse that is a movement and no leap of the pointer, pixels.
const LEAP_PX: i16 = 400;
/// Bytes of a request beside its pixels.
const REQUEST_BYTES: usize = 64;

/// A window that shows the image and sends its keys.
pub struct Window {
    server: RustConnection,
    id: WindowId,
    context: Gcontext,
    depth: u8,
    delete: u32,
    /// Symbol of every key without and with Shift, by code.
    symbols: Vec<[u32; 2]>,
    first_code: u8,
    size_px: [u16; 2],
    dragged_from: Option<[i16; 2]>,
    /// What is shown now, its size and its corner.
    shown: Option<(Vec<u8>, [u32; 2], [u32; 2])>,
    title: String,
}

impl std::fmt::Debug for Window {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Window")
            .field("id", &self.id)
            .field("size_px", &self.size_px)
            .finish_non_exhaustive()
    }
}

impl Window {
    /// Opens a window on the display of `DISPLAY`.
    ///
    /// # Errors
    /// Without a display, or if it has no colours of 24 bits.
    pub fn open() -> anyhow::Result<Window> {
        let (server, screen) = x11rb::connect(None)
            .context("cannot reach the display that DISPLAY names; over SSH use --fly=terminal")?;
        let setup = server.setup();
        let root = setup
            .roots
            .get(screen)
            .context("the display has no screen")?;
        let (depth, window_root, black) = (root.root_depth, root.root, root.black_pixel);
        let format = setup
            .pixmap_formats
            .iter()
            .find(|format| format.depth == depth);
        let is_usual = depth >= 24
            && format.is_some_and(|format| format.bits_per_pixel == 32)
            && setup.image_byte_order == ImageOrder::LSB_FIRST;
        ensure!(
            is_usual,
            "the display has colours of {depth} bits, but must have 24 or more in words of 32; use --fly=terminal"
        );
        let (first_code, last_code) = (setup.min_keycode, setup.max_keycode);
        let [width, height] = FIRST_SIZE_PX;
        let id = server.generate_id()?;
        let events = EventMask::KEY_PRESS
            | EventMask::KEY_RELEASE
            | EventMask::BUTTON_PRESS
            | EventMask::BUTTON_RELEASE
            | EventMask::BUTTON_MOTION
            | EventMask::EXPOSURE
            | EventMask::STRUCTURE_NOTIFY
            | EventMask::FOCUS_CHANGE;
        server.create_window(
            depth,
            id,
            window_root,
            0,
            0,
            width,
            height,
            0,
            WindowClass::INPUT_OUTPUT,
            0,
            &CreateWindowAux::new()
                .background_pixel(black)
                .event_mask(events),
        )?;
        let atom =
            |name: &str| anyhow::Ok(server.intern_atom(false, name.as_bytes())?.reply()?.atom);
        let (protocols, delete) = (atom("WM_PROTOCOLS")?, atom("WM_DELETE_WINDOW")?);
        server.change_property32(PropMode::REPLACE, id, protocols, AtomEnum::ATOM, &[delete])?;
        let class = b"gantry-view\0Gantry\0";
        server.change_property8(
            PropMode::REPLACE,
            id,
            AtomEnum::WM_CLASS,
            AtomEnum::STRING,
            class,
        )?;
        let context = server.generate_id()?;
        server.create_gc(context, id, &CreateGCAux::new().foreground(black))?;
        let n_codes = last_code - first_code + 1;
        let keys = server.get_keyboard_mapping(first_code, n_codes)?.reply()?;
        let per_code = usize::from(keys.keysyms_per_keycode.max(1));
        let symbols = keys
            .keysyms
            .chunks(per_code)
            .map(|of_code| [of_code[0], of_code.get(1).copied().unwrap_or(0)])
            .collect();
        server.map_window(id)?;
        server.flush()?;
        let mut window = Window {
            server,
            id,
            context,
            depth,
            delete,
            symbols,
            first_code,
            size_px: FIRST_SIZE_PX,
            dragged_from: None,
            shown: None,
            title: String::new(),
        };
        window.say("Gantry spectator")?;
        Ok(window)
    }

    fn take(&mut self, event: Event, inputs: &mut Vec<Input>) -> anyhow::Result<()> {
        match event {
            Event::KeyPress(key) => inputs.extend(self.of_key(&key, true)),
            Event::KeyRelease(key) => inputs.extend(self.of_key(&key, false)),
            Event::ButtonPress(button) => self.press(&button, inputs),
            Event::ButtonRelease(button) if button.detail <= 3 => self.dragged_from = None,
            Event::MotionNotify(motion) => inputs.extend(self.drag(&motion)?),
            Event::ConfigureNotify(ConfigureNotifyEvent { width, height, .. }) => {
                self.size_px = [width, height];
            }
            Event::Expose(expose) if expose.count == 0 => self.put()?,
            Event::FocusOut(_) => inputs.push(Input::ReleaseAll),
            Event::ClientMessage(message) if message.data.as_data32()[0] == self.delete => {
                inputs.push(Input::Close);
            }
            Event::DestroyNotify(_) => inputs.push(Input::Close),
            Event::Error(error) => bail!("the display refuses: {error:?}"),
            _ => {}
        }
        Ok(())
    }

    fn of_key(&self, key: &KeyPressEvent, down: bool) -> Option<Input> {
        let idx = usize::from(key.detail.checked_sub(self.first_code)?);
        let [symbol, shifted] = *self.symbols.get(idx)?;
        // Keyboards of other alphabets have Latin letters in no column; their places are known.
        let letter = [symbol, shifted]
            .into_iter()
            .find_map(latin)
            .or_else(|| letter_at(key.detail));
        let held = match symbol {
            0xffe1 | 0xffe2 => Held::Fast,
            0xff51 => Held::TurnLeft,
            0xff52 => Held::LookUp,
            0xff53 => Held::TurnRight,
            0xff54 => Held::LookDown,
            0xff1b => return down.then_some(Input::Close),
            _ => return of_letter(letter?, down),
        };
        Some(Input::Hold(held, down))
    }

    fn press(&mut self, button: &ButtonPressEvent, inputs: &mut Vec<Input>) {
        match button.detail {
            1..=3 => self.dragged_from = Some([button.event_x, button.event_y]),
            4 => inputs.push(Input::Wheel(1.0)),
            5 => inputs.push(Input::Wheel(-1.0)),
            _ => {}
        }
    }

    /// Turns with the mouse. At the window's edge the pointer goes back to the middle, so that one
    /// may turn on.
    fn drag(&mut self, motion: &MotionNotifyEvent) -> anyhow::Result<Option<Input>> {
        let now = [motion.event_x, motion.event_y];
        let Some(before) = self.dragged_from.replace(now) else {
            self.dragged_from = None;
            return Ok(None);
        };
        let moved = [0, 1].map(|i| now[i].saturating_sub(before[i]));
        if moved.iter().any(|by| by.saturating_abs() > LEAP_PX) {
            return Ok(None);
        }
        let [width, height] = self
            .size_px
            .map(|side| i16::try_from(side).unwrap_or(i16::MAX));
        let edge = |at: i16, side: i16| at < side / 16 || at > side - side / 16;
        if edge(now[0], width) || edge(now[1], height) {
            let middle = [width / 2, height / 2];
            self.server
                .warp_pointer(x11rb::NONE, self.id, 0, 0, 0, 0, middle[0], middle[1])?;
            self.dragged_from = Some(middle);
        }
        Ok(Some(Input::Turn {
            yaw_rad: -f64::from(moved[0]) * TURN_PER_PX,
            pitch_rad: f64::from(moved[1]) * TURN_PER_PX,
        }))
    }

    /// Sends the pixels, in pieces that the server takes.
    fn put(&self) -> anyhow::Result<()> {
        let Some((pixels, [width, height], [left, top])) = &self.shown else {
            return Ok(());
        };
        let row_bytes = 4 * *width as usize;
        let room = self.server.maximum_request_bytes() - REQUEST_BYTES;
        let n_rows = (room / row_bytes.max(1)).max(1);
        for (piece, rows) in pixels.chunks(n_rows * row_bytes).enumerate() {
            self.server.put_image(
                ImageFormat::Z_PIXMAP,
                self.id,
                self.context,
                *width as u16,
                (rows.len() / row_bytes) as u16,
                *left as i16,
                (*top as usize + piece * n_rows) as i16,
                0,
                self.depth,
                rows,
            )?;
        }
        self.frame([*width, *height], [*left, *top])?;
        self.server.flush()?;
        Ok(())
    }

    /// Blackens what lies beside the image.
    fn frame(&self, [width, height]: [u32; 2], [left, top]: [u32; 2]) -> anyhow::Result<()> {
        let [room_w, room_h] = self.size_px.map(u32::from);
        let bars = [
            [0, 0, room_w, top],
            [0, top + height, room_w, room_h.saturating_sub(top + height)],
            [0, 0, left, room_h],
            [left + width, 0, room_w.saturating_sub(left + width), room_h],
        ];
        let bars: Vec<Rectangle> = bars
            .into_iter()
            .filter(|[_, _, w, h]| *w > 0 && *h > 0)
            .map(|[x, y, width, height]| Rectangle {
                x: x as i16,
                y: y as i16,
                width: width as u16,
                height: height as u16,
            })
            .collect();
        if !bars.is_empty() {
            self.server
                .poly_fill_rectangle(self.id, self.context, &bars)?;
        }
        Ok(())
    }
}

impl Screen for Window {
    fn poll(&mut self) -> anyhow::Result<Vec<Input>> {
        let mut inputs = Vec::new();
        let mut events = Vec::new();
        while let Some(event) = self
            .server
            .poll_for_event()
            .context("the display has gone")?
        {
            events.push(event);
        }
        let mut events = events.into_iter().peekable();
        while let Some(event) = events.next() {
            // A key that is held repeats as a release and a press at one time; neither is one.
            if let (Event::KeyRelease(up), Some(Event::KeyPress(down))) = (&event, events.peek())
                && up.detail == down.detail
                && up.time == down.time
            {
                events.next();
                continue;
            }
            self.take(event, &mut inputs)?;
        }
        Ok(inputs)
    }

    fn show(&mut self, picture: &Picture<'_>) -> anyhow::Result<()> {
        let room = self.size_px.map(u32::from);
        let (size, corner) = fit([picture.width_px, picture.height_px], room);
        if let Some(pixels) = scaled(picture, size) {
            self.shown = Some((bytemuck::cast_slice(&pixels).to_vec(), size, corner));
            self.put()?;
        }
        Ok(())
    }

    fn say(&mut self, line: &str) -> anyhow::Result<()> {
        if self.title != line {
            line.clone_into(&mut self.title);
            let name = self
                .server
                .intern_atom(false, b"_NET_WM_NAME")?
                .reply()?
                .atom;
            let text = self
                .server
                .intern_atom(false, b"UTF8_STRING")?
                .reply()?
                .atom;
            let bytes = line.as_bytes();
            self.server
                .change_property8(PropMode::REPLACE, self.id, name, text, bytes)?;
            let old = AtomEnum::WM_NAME;
            self.server.change_property8(
                PropMode::REPLACE,
                self.id,
                old,
                AtomEnum::STRING,
                bytes,
            )?;
            self.server.flush()?;
        }
        Ok(())
    }
}

/// The letter of a key symbol.
fn latin(symbol: u32) -> Option<char> {
    char::from_u32(symbol).filter(char::is_ascii_alphabetic)
}

/// The letter of a key's place on a keyboard of the United States.
fn letter_at(code: u8) -> Option<char> {
    let rows = [(24, "qwertyuiop"), (38, "asdfghjkl"), (52, "zxcvbnm")];
    rows.iter().find_map(|(first, letters)| {
        let idx = code.checked_sub(*first)?;
        letters.chars().nth(usize::from(idx))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_letters_by_symbol_and_by_place() {
        assert_eq!(latin(0x77), Some('w'));
        assert_eq!(latin(0x06c3), None, "Cyrillic");
        assert_eq!(letter_at(25), Some('w'));
        assert_eq!(letter_at(38), Some('a'));
        assert_eq!(letter_at(9), None);
    }
}
