// SPDX-License-Identifier: MIT
//! `hfx_play CLIP [NAME]` prints the values of all columns at 60 frames a second of the clip's own time as CSV.

use hfx_player::Player;
use std::error::Error;

fn print(path: &str, name: Option<&str>) -> Result<(), Box<dyn Error>> {
    let mut player = Player::open(&std::fs::read(path)?)?;
    player.play(name)?;
    player.set_loop(false); // an end, also for a named clip that is meant to loop
    let names = player.columns().into_iter().map(|column| format!(",{} {}", column.actuator, column.parameter));
    println!("time_s{}", names.collect::<String>());
    while player.is_playing() {
        let values: String = player.advance(1.0 / 60.0).iter().map(|value| format!(",{value:.4}")).collect();
        println!("{:.4}{values}", player.position());
    }
    Ok(())
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some(path) = arguments.first() else {
        eprintln!("usage: hfx_play CLIP [NAME]");
        std::process::exit(2);
    };
    if let Err(fault) = print(path, arguments.get(1).map(String::as_str)) {
        eprintln!("{path}: {fault}");
        std::process::exit(3);
    }
}
