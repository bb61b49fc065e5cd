# SPDX-License-Identifier: MIT
class_name HapticOutput
extends Node
## Sends the values of a device to HFX on this computer, which drives it with all its limits:
## [code]hfx play x.hfxclip --device NAME --listen 7010[/code]
##
## Sources may have several clips of the device. Of several sources the strongest counts, for each
## actuator. HFX silences the device where nothing comes for 250 ms, should the game hang.

const _ADDRESS := "127.0.0.1"
const _TOKEN_DIGITS := 32

## Players and bodies.
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
	for found in source.clip.get_devices():
		if device == "" or found.id == device:
			_socket.put_packet(_datagram(found, source.clip))
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
	for actuator in _actuators_of(clip, found.id):
		packet.append_array(_strongest(actuator, clip, found.id).to_byte_array())
	return packet


static func _actuators_of(clip: HapticClip, id: String) -> Array[Dictionary]:
	for found in clip.get_devices():
		if found.id == id:
			var first: int = found.first_actuator
			return clip.get_actuators().slice(first, first + int(found.actuators))
	return []


## Values of an actuator, from the source that is farthest from neutral there.
func _strongest(actuator: Dictionary, clip: HapticClip, id: String) -> PackedFloat32Array:
	var farthest := -1.0
	var values := PackedFloat32Array()
	for source in _felt.keys():
		if not is_instance_valid(source):
			_felt.erase(source)
			continue
		var same := actuator
		if source.clip != clip:  # a clip that has the actuator elsewhere, if at all
			same = {}
			for other in _actuators_of(source.clip, id):
				if other.id == actuator.id and other.columns == actuator.columns:
					same = other
		if same.is_empty():
			continue
		var first: int = same.first_column
		var away := absf(_felt[source][first] - source.clip.get_columns()[first].neutral)
		if away > farthest:
			farthest = away
			values = _felt[source].slice(first, first + int(same.columns))
	return values
