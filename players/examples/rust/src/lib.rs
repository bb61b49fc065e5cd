// SPDX-License-Identifier: MIT
//! Plays haptic clips (.hfxclip) with the compiled core, `hfx_haptics`; of Rust only `std`.

use std::ffi::{c_char, c_void, CStr, CString};
use std::ptr::{null, NonNull};

#[link(name = "hfx_haptics")]
extern "C" {
    fn hfx_live_error(error: i32) -> *const c_char;
    fn hfx_live_player_open(bytes: *const u8, size: usize, error: *mut i32) -> *mut c_void;
    fn hfx_live_player_close(player: *mut c_void);
    fn hfx_live_player_seconds(player: *const c_void) -> f64;
    fn hfx_live_player_columns(player: *const c_void) -> u32;
    fn hfx_live_player_column(
        player: *const c_void,
        index: u32,
        actuator: *mut *const c_char,
        parameter: *mut *const c_char,
        unit: *mut *const c_char,
        lowest: *mut f64,
        highest: *mut f64,
        neutral: *mut f64,
    ) -> i32;
    fn hfx_live_player_device(
        player: *const c_void,
        index: u32,
        id: *mut *const c_char,
        first_column: *mut u32,
        columns: *mut u32,
        dead_man_ms: *mut u32,
    ) -> i32;
    fn hfx_live_player_play(player: *mut c_void, name: *const c_char) -> i32;
    fn hfx_live_player_advance(player: *mut c_void, seconds: f64, out: *mut f32, count: u32) -> i32;
    fn hfx_live_player_silence(player: *mut c_void, out: *mut f32, count: u32) -> i32;
    fn hfx_live_player_pause(player: *mut c_void, is_paused: i32) -> i32;
    fn hfx_live_player_stop(player: *mut c_void) -> i32;
    fn hfx_live_player_seek(player: *mut c_void, seconds: f64) -> i32;
    fn hfx_live_player_loop(player: *mut c_void, loops: i32) -> i32;
    fn hfx_live_player_gain(player: *mut c_void, gain: f64) -> i32;
    fn hfx_live_player_place(player: *mut c_void, turn: f64, raise: f64, stretch: f64) -> i32;
    fn hfx_live_player_set_parameter(player: *mut c_void, name: *const c_char, factor: f64) -> i32;
    fn hfx_live_player_is_playing(player: *const c_void) -> i32;
    fn hfx_live_player_position(player: *const c_void) -> f64;
}

const ERROR_NAME: i32 = -7;

/// Why a call failed: a number of the core, and one sentence in English.
#[derive(Debug)]
pub struct Error {
    pub code: i32,
    pub message: String,
}

impl std::fmt::Display for Error {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str(&self.message)
    }
}

impl std::error::Error for Error {}

fn checked(code: i32) -> Result<(), Error> {
    if code == 0 {
        return Ok(());
    }
    // The core gives a text of its own for every number.
    let message = unsafe { text(hfx_live_error(code)) };
    Err(Error { code, message })
}

/// # Safety
/// `of` is null or ends with 0.
unsafe fn text(of: *const c_char) -> String {
    if of.is_null() {
        return String::new();
    }
    CStr::from_ptr(of).to_string_lossy().into_owned()
}

/// One value of an actuator, with its unit and limits.
#[derive(Debug, Clone)]
pub struct Column {
    pub actuator: String,
    pub parameter: String,
    pub unit: String,
    pub lowest: f64,
    pub highest: f64,
    pub neutral: f64,
}

/// A device and its columns. An output has to be silent `dead_man_ms` after the last value.
#[derive(Debug, Clone)]
pub struct Device {
    pub id: String,
    pub columns: std::ops::Range<usize>,
    pub dead_man_ms: u32,
}

/// A player of one clip. It may be sent to another thread, and is used by one at a time.
pub struct Player {
    player: NonNull<c_void>,
    values: Vec<f32>,
}

unsafe impl Send for Player {}

impl Player {
    /// Copies and checks the bytes of a clip; it does not play yet.
    pub fn open(clip: &[u8]) -> Result<Player, Error> {
        let mut code = 0;
        let opened = unsafe { hfx_live_player_open(clip.as_ptr(), clip.len(), &mut code) };
        let Some(player) = NonNull::new(opened) else {
            checked(code)?;
            unreachable!("the core says why it refuses a clip");
        };
        let count = unsafe { hfx_live_player_columns(player.as_ptr()) };
        Ok(Player { player, values: vec![0.0; count as usize] })
    }

    /// Length of the clip.
    pub fn seconds(&self) -> f64 {
        unsafe { hfx_live_player_seconds(self.player.as_ptr()) }
    }

    /// One for each value of `advance`.
    pub fn columns(&self) -> Vec<Column> {
        (0..self.values.len() as u32)
            .map(|index| unsafe {
                let (mut actuator, mut parameter, mut unit) = (null(), null(), null());
                let (mut lowest, mut highest, mut neutral) = (0.0, 0.0, 0.0);
                hfx_live_player_column(
                    self.player.as_ptr(),
                    index,
                    &mut actuator,
                    &mut parameter,
                    &mut unit,
                    &mut lowest,
                    &mut highest,
                    &mut neutral,
                );
                let [actuator, parameter, unit] = [actuator, parameter, unit].map(|of| text(of));
                Column { actuator, parameter, unit, lowest, highest, neutral }
            })
            .collect()
    }

    /// Devices in the order of their columns.
    pub fn devices(&self) -> Vec<Device> {
        let mut found = Vec::new();
        loop {
            let (mut id, mut first, mut count, mut dead_man_ms) = (null(), 0, 0, 0);
            let index = found.len() as u32;
            let player = self.player.as_ptr();
            unsafe {
                if hfx_live_player_device(player, index, &mut id, &mut first, &mut count, &mut dead_man_ms) != 0 {
                    return found;
                }
                let columns = first as usize..(first + count) as usize;
                found.push(Device { id: text(id), columns, dead_man_ms });
            }
        }
    }

    /// Begins with the whole clip (`None`) or a named one. An unknown name is an error, and silence.
    pub fn play(&mut self, name: Option<&str>) -> Result<(), Error> {
        let Ok(name) = CString::new(name.unwrap_or("")) else {
            self.stop();
            return checked(ERROR_NAME);
        };
        checked(unsafe { hfx_live_player_play(self.player.as_ptr(), name.as_ptr()) })
    }

    /// Goes on by the seconds since the last call; values of all columns, in their units.
    pub fn advance(&mut self, seconds: f64) -> &[f32] {
        let (out, count) = (self.values.as_mut_ptr(), self.values.len() as u32);
        unsafe { hfx_live_player_advance(self.player.as_ptr(), seconds, out, count) };
        &self.values
    }

    /// Pauses; neutral values of all columns.
    pub fn silence(&mut self) -> &[f32] {
        let (out, count) = (self.values.as_mut_ptr(), self.values.len() as u32);
        unsafe { hfx_live_player_silence(self.player.as_ptr(), out, count) };
        &self.values
    }

    /// Stands still with neutral values, or goes on.
    pub fn pause(&mut self, is_paused: bool) {
        unsafe { hfx_live_player_pause(self.player.as_ptr(), is_paused.into()) };
    }

    /// Ends in silence, at the beginning of what was played.
    pub fn stop(&mut self) {
        unsafe { hfx_live_player_stop(self.player.as_ptr()) };
    }

    /// Jumps to a time from the beginning of the clip; nothing between is felt.
    pub fn seek(&mut self, seconds: f64) {
        unsafe { hfx_live_player_seek(self.player.as_ptr(), seconds) };
    }

    /// Sets whether the whole clip, and what plays now, begins again at its end.
    pub fn set_loop(&mut self, loops: bool) {
        unsafe { hfx_live_player_loop(self.player.as_ptr(), loops.into()) };
    }

    /// Scales all strengths: 0 is silence, 1 as made.
    pub fn set_gain(&mut self, gain: f64) {
        unsafe { hfx_live_player_gain(self.player.as_ptr(), gain) };
    }

    /// Turns all to the left about the body by degrees, raises it by metres, and multiplies heights; 0, 0, 1: as made.
    pub fn place(&mut self, turn_degrees: f64, raise_m: f64, stretch: f64) {
        unsafe { hfx_live_player_place(self.player.as_ptr(), turn_degrees, raise_m, stretch) };
    }

    /// Scales one parameter, say `amplitude_m_s2`; an error if no column has this name.
    pub fn set_parameter(&mut self, parameter: &str, factor: f64) -> Result<(), Error> {
        let name = CString::new(parameter).unwrap_or_default();
        checked(unsafe { hfx_live_player_set_parameter(self.player.as_ptr(), name.as_ptr(), factor) })
    }

    /// Whether a clip plays, paused or not.
    pub fn is_playing(&self) -> bool {
        unsafe { hfx_live_player_is_playing(self.player.as_ptr()) != 0 }
    }

    /// Seconds from the beginning of the clip.
    pub fn position(&self) -> f64 {
        unsafe { hfx_live_player_position(self.player.as_ptr()) }
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        unsafe { hfx_live_player_close(self.player.as_ptr()) };
    }
}
