// SPDX-License-Identifier: MIT
//
// Clips, players, bodies and strokes as C++ objects that own their memory: C++14, this header and
// the core, no exceptions, no RTTI. An object that failed to open is safe to use, and silent.
//
//   hfx::Clip clip(std::move(bytes));       // std::vector<unsigned char>; if (!clip) clip.error_text()
//   hfx::Player player(clip);
//   player.play("Strike");
//   const std::vector<float> &values = player.advance(seconds);   // each frame
//
// Copies of a clip share its bytes, which stay while any copy, player or body exists. Threads may
// share clips; a player or a body is used by one thread at a time.
#ifndef HFX_PLAYER_HPP
#define HFX_PLAYER_HPP

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "hfx_player.h"

namespace hfx {

class Clip {
 public:
  Clip() : Clip(std::vector<unsigned char>()) {}
  // Takes the bytes of a file over and checks them.
  explicit Clip(std::vector<unsigned char> bytes) {
    auto opened = std::make_shared<Content>();
    opened->bytes = std::move(bytes);
    opened->error = hfx_clip_open(&opened->clip, opened->bytes.data(), opened->bytes.size());
    content_ = std::move(opened);
  }

  explicit operator bool() const { return error() == 0; }
  int error() const { return content_->error; }  // 0, or an hfx_error
  const char *error_text() const { return hfx_error_text(error()); }

  double seconds() const { return hfx_clip_seconds(&core()); }
  // All facts of one kind, in the order of the clip. Texts stay while the clip exists.
  std::vector<hfx_device> devices() const { return all<hfx_device>(hfx_clip_device); }
  std::vector<hfx_actuator> actuators() const { return all<hfx_actuator>(hfx_clip_actuator); }
  std::vector<hfx_column> columns() const { return all<hfx_column>(hfx_clip_column); }
  std::vector<hfx_named_clip> named_clips() const {
    return all<hfx_named_clip>(hfx_clip_named_clip);
  }
  std::vector<hfx_effect> effects() const { return all<hfx_effect>(hfx_clip_effect); }
  std::vector<hfx_surface> surfaces() const { return all<hfx_surface>(hfx_clip_surface); }
  std::vector<hfx_bone> bones(std::uint32_t body) const {
    std::vector<hfx_bone> found(hfx_clip_bones(&core(), body));
    for (std::uint32_t k = 0; k < found.size(); k++) hfx_clip_bone(&core(), body, k, &found[k]);
    return found;
  }
  // For functions of the core.
  const hfx_clip &core() const { return content_->clip; }

 private:
  struct Content {
    std::vector<unsigned char> bytes;
    hfx_clip clip = {};
    int error = 0;
  };

  template <class Fact>
  std::vector<Fact> all(int (*fact_at)(const hfx_clip *, std::uint32_t, Fact *)) const {
    std::vector<Fact> found;
    Fact fact;
    while (fact_at(&core(), static_cast<std::uint32_t>(found.size()), &fact) == 0)
      found.push_back(fact);
    return found;
  }

  std::shared_ptr<const Content> content_;
};

// Plays the baked part. Gain, factors and loop stay where something else is played.
class Player {
 public:
  Player() : Player(Clip()) {}
  explicit Player(Clip clip) : clip_(std::move(clip)), values_(hfx_clip_columns(&clip_.core())) {
    hfx_player_play(&player_, &clip_.core());
    hfx_player_stop(&player_);
    hfx_player_advance(&player_, 0.0, values_.data());
  }

  const Clip &clip() const { return clip_; }
  // Begins with the whole clip.
  void play() { hfx_player_replay(&player_, nullptr); }
  // Begins with a named clip, which loops if it is meant to; false, and silence: unknown name.
  bool play(const std::string &name) { return hfx_player_replay(&player_, name.c_str()) == 0; }
  // Goes on; one value for each column, in its unit, until the next call.
  const std::vector<float> &advance(double seconds) {
    hfx_player_advance(&player_, seconds, values_.data());
    return values_;
  }
  // Neutral values, and pause.
  const std::vector<float> &silence() {
    hfx_player_silence(&player_, values_.data());
    return values_;
  }
  // Values of the last advance or silence.
  const std::vector<float> &values() const { return values_; }
  void pause(bool is_paused) { hfx_player_pause(&player_, is_paused); }
  void stop() { hfx_player_stop(&player_); }
  void seek(double seconds) { hfx_player_seek(&player_, seconds); }
  void loop(bool loops) { hfx_player_loop(&player_, loops); }
  void gain(double gain) { hfx_player_gain(&player_, gain); }
  // Turns all about the body, raises it by metres, and scales heights; 0, 0, 1: as made.
  void place(double turn_degrees, double raise_m = 0.0, double stretch = 1.0) {
    hfx_player_place(&player_, turn_degrees, raise_m, stretch);
  }
  bool set_parameter(const std::string &parameter, double factor) {
    return hfx_player_set_parameter(&player_, parameter.c_str(), factor) == 0;
  }
  bool is_playing() const { return hfx_player_is_playing(&player_) != 0; }
  double position() const { return hfx_player_position(&player_); }

 private:
  Clip clip_;
  hfx_player player_ = {};
  std::vector<float> values_;
};

// Evaluates the spatial part on a live avatar. It is moved, never copied.
class Body {
 public:
  Body() : Body(Clip()) {}
  // `body` is an index in the clip.
  explicit Body(Clip clip, std::uint32_t body = 0) : Body(clip, body, clip) {}
  // Feels the effects of another clip on this body: a library for all avatars.
  Body(Clip clip, std::uint32_t body, Clip effects)
      : clip_(std::move(clip)),
        effects_(std::move(effects)),
        number_(body),
        values_(hfx_clip_columns(&clip_.core())) {
    const std::size_t size = hfx_body_effects_bytes(&clip_.core(), body, &effects_.core());
    body_ = std::make_unique<hfx_body>();
    memory_ = std::make_unique<unsigned char[]>(size);
    if (!clip_) error_ = clip_.error();
    else if (!effects_) error_ = effects_.error();
    else error_ = hfx_body_open_effects(body_.get(), &clip_.core(), body, &effects_.core(),
                                        memory_.get(), size);
  }

  explicit operator bool() const { return error_ == 0; }
  int error() const { return error_; }
  const char *error_text() const { return hfx_error_text(error_); }
  const Clip &clip() const { return clip_; }

  // Poses the body: 12 numbers for each bone, rest space to world; false: not as many.
  bool set_bones(const float *matrices, std::size_t count) {
    if (error_ || count != 12u * hfx_clip_bones(&clip_.core(), number_)) return false;
    hfx_body_set_bones(body_.get(), matrices);
    return true;
  }
  // Places a volume by its 3 x 4 matrix, row after row; false: there is no such effect.
  bool set_volume(std::uint32_t effect, const float (&matrix)[12]) {
    return !error_ && hfx_body_set_volume(body_.get(), effect, matrix) == 0;
  }
  bool set_parameter(std::uint32_t effect, std::uint32_t parameter, double value) {
    return !error_ && hfx_body_set_parameter(body_.get(), effect, parameter, value) == 0;
  }
  // Turns an effect on at a factor of 0 (off) to 1 of its level in the clip.
  bool trigger(std::uint32_t effect, double factor) {
    return !error_ && hfx_body_trigger(body_.get(), effect, factor) == 0;
  }
  // Turns, raises and stretches a painted area; false: there is none of this number.
  bool place(std::uint32_t effect, double turn_degrees, double raise_m = 0.0,
             double stretch = 1.0) {
    return !error_ &&
           hfx_body_place(body_.get(), effect, turn_degrees, raise_m, stretch) == 0;
  }
  // Adds one more volume of an effect, off; its number stands for an effect. HFX_NONE: failed.
  std::uint32_t add_volume(std::uint32_t effect) {
    const std::size_t size =
        error_ ? 0
               : hfx_body_effects_volume_bytes(&clip_.core(), number_, &effects_.core(), effect);
    if (!size) return HFX_NONE;
    auto memory = std::make_unique<unsigned char[]>(size);
    const std::uint32_t number = hfx_body_add_volume(body_.get(), effect, memory.get(), size);
    if (number != HFX_NONE) volumes_[number] = std::move(memory);
    return number;
  }
  // Removes an added volume; false: there is none of this number.
  bool remove_volume(std::uint32_t number) {
    if (error_ || !hfx_body_remove_volume(body_.get(), number)) return false;
    volumes_.erase(number);
    return true;
  }
  // Evaluates the body; one value for each column, in its unit, until the next call.
  const std::vector<float> &evaluate(double seconds) {
    if (error_) return values_;
    hfx_body_evaluate(body_.get(), seconds, values_.data());
    return values_;
  }
  double level(std::uint32_t effect) const {
    return error_ ? 0.0 : hfx_body_level(body_.get(), effect);
  }

 private:
  Clip clip_, effects_;
  std::uint32_t number_;
  std::vector<float> values_;
  std::unique_ptr<hfx_body> body_;
  std::unique_ptr<unsigned char[]> memory_;
  std::map<std::uint32_t, std::unique_ptr<unsigned char[]>> volumes_;
  int error_ = 0;
};

// A finger on a haptic surface: peak amplitude and frequency of its path.
class Stroke {
 public:
  Stroke() : Stroke(Clip(), 0) {}
  // `surface` is an index in the clip.
  Stroke(Clip clip, std::uint32_t surface) : clip_(std::move(clip)), surface_(surface) {}

  // Moves to a place, shares of the map's width and height, `seconds` after the last call; a speed
  // below 0 is that of the path. False, and silence: there is no such surface.
  bool feel(double u, double v, double seconds, double speed_mm_s = -1.0) {
    const hfx_clip *clip = &clip_.core();
    return hfx_surface_feel(clip, surface_, &stroke_, u, v, speed_mm_s, seconds, out_) == 0;
  }
  // Ends the touch, in silence.
  void lift() {
    hfx_surface_lift(&stroke_);
    out_[0] = 0.0f;
  }
  float amplitude_m_s2() const { return out_[0]; }
  float frequency_hz() const { return out_[1]; }

 private:
  Clip clip_;
  std::uint32_t surface_;
  hfx_stroke stroke_ = {};
  float out_[2] = {0.0f, 0.0f};
};

}  // namespace hfx

#endif
