# SPDX-License-Identifier: MIT
class_name HapticOutput
extends Node
## Sends the values of a device to HFX on this computer, which drives it with all its limits:
## [code]hfx play x.hfxclip --device NAME --listen 7010[/code]
##
## The clip is the one that the sources play. Of several sources the strongest counts, for each
## actuator. HFX silences the device where nothing comes for 250 ms, should the game hang.

const _ADDRESS := "127.0.0.1"
const _TOKEN_DIGITS := 32

## Players and bodies of one clip.
@export var sources: Array[HapticSource] = []:
	set(value):
		for source in sources:
			if is_instance_valid(source) and source.values_changed.is_connected(_send):
				source.values_changed.disconnect(_send)
		sources = value
		_felt.clear()
		for source in sources:
			if source != null:
				source.values_changed.connect(_send.bind(source))
## Id of the device in the clip (say waist_belt); empty: its first.
@export var device := ""
@export_range(1, 65535) var port := 7010:
	set(value):
		port = value
		_socket.close()
## What HFX shows as it begins; empty: the environment variable HFX_TOKEN, which HFX takes, too.
@export var token := "":
	set(value):
		token = value
		_is_ready = false

var _socket := PacketPeerUDP.new()
var _head := PackedByteArray()  # empty: without a token
var _is_ready := false
var _number := 0
var _felt := {}  # source: its newest values


func _send(values: PackedFloat32Array, source: HapticSource) -> void:
	_felt[source] = values
	if not is_inside_tree() or not _has_token():
		return
	if not _socket.is_socket_connected():
		_socket.connect_to_host(_ADDRESS, port)
	for each in source.clip.get_devices():
		if device != "" and each.id != device:
			continue
		_socket.put_packet(_datagram(each, source.clip))
		return


func _has_token() -> bool:
	if not _is_ready:
		_is_ready = true
		_head.clear()
		var digits := token if token != "" else OS.get_environment("HFX_TOKEN")
		if digits.length() == _TOKEN_DIGITS and digits.is_valid_hex_number():
			_head = "HFX1".to_ascii_buffer() + digits.hex_decode()
		else:
			push_error("HapticOutput '%s': the token has to be %d hexadecimal digits." % [name, _TOKEN_DIGITS])
	return not _head.is_empty()


func _datagram(found: Dictionary, clip: HapticClip) -> PackedByteArray:
	_number += 1
	var id: PackedByteArray = found.id.to_utf8_buffer()
	var packet := _head.duplicate()
	packet.resize(_head.size() + 5)
	packet.encode_u32(_head.size(), _number)
	packet.encode_u8(_head.size() + 4, id.size())
	packet.append_array(id)
	var actuators := clip.get_actuators()
	for k in range(found.first_actuator, mini(found.first_actuator + found.actuators, actuators.size())):
		packet.append_array(_strongest(actuators[k], clip).to_byte_array())
	return packet


func _strongest(actuator: Dictionary, clip: HapticClip) -> PackedFloat32Array:
	var first: int = actuator.first_column
	var neutral: float = clip.get_columns()[first].neutral
	var farthest := -1.0
	var found := PackedFloat32Array()
	for values: PackedFloat32Array in _felt.values():
		var away := absf(values[first] - neutral) if values.size() > first else -1.0
		if away > farthest:
			farthest = away
			found = values.slice(first, first + int(actuator.columns))
	return found
