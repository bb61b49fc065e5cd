// SPDX-License-Identifier: MIT
using System;
using UnityEngine;

namespace Hfx.Haptics
{
    /// <summary>
    /// Plays a haptic clip in step with the game. An output, say <see cref="ControllerHaptics"/>, takes
    /// the values from <see cref="ValuesChanged"/>. Everything is neutral while nothing plays, while
    /// the game is paused or has lost its focus, and when the component is disabled.
    /// </summary>
    [AddComponentMenu("Haptics/Haptic Player")]
    public sealed class HapticPlayer : MonoBehaviour
    {
        [SerializeField] HapticClipAsset clip;
        [SerializeField] bool playOnEnable;
        [SerializeField] bool loop;
        [SerializeField, Range(0.0f, 4.0f)] float gain = 1.0f;

        /// <summary>Seconds of the clip in a second of the game; 0 stands still.</summary>
        [SerializeField, Range(0.0f, 4.0f)] float speed = 1.0f;

        /// <summary>Turns all about the body: degrees to the left, seen from above counterclockwise.</summary>
        [SerializeField] float turnDegrees;
        /// <summary>Raises all by metres.</summary>
        [SerializeField] float raise;
        /// <summary>Multiplies heights about the middle of each device.</summary>
        [SerializeField] float stretch = 1.0f;

        /// <summary>
        /// Plays in step with the state of this animator, wherever it plays, jumps or stops: the named clip of the
        /// state's name, else the whole clip. Play, Seek, Loop and Speed have no effect then.
        /// </summary>
        [SerializeField] Animator follow;
        [SerializeField] int followedLayer;

        ClipPlayer player;
        float[] values;
        int followed; // hash of the animator's state; 0: none
        bool isLooping; // as last given to the player
        bool isHeld, isUnfocused, isPaused; // by the game; the application has lost its focus, is paused

        /// <summary>Each frame in which something plays, and once more when it ends: all columns, in their units.</summary>
        public event Action<HapticPlayer> ValuesChanged;
        /// <summary>The clip came to its end by itself.</summary>
        public event Action Finished;

        /// <summary>The clip's file; another one ends what plays.</summary>
        public HapticClipAsset Asset
        {
            get { return clip; }
            set
            {
                Stop();
                clip = value;
                player = null;
            }
        }

        public HapticClip Clip { get { return clip != null ? clip.Clip : null; } }
        public float[] Values { get { return values; } }
        public bool IsPlaying { get { return player != null && player.IsPlaying; } }
        /// <summary>Seconds from the beginning of the clip; where it has ended by itself, its end.</summary>
        public double Position { get { return player != null ? player.Position : 0.0; } }
        public float Gain { get { return gain; } set { gain = value; } }
        /// <summary>The animator that is followed; null: none.</summary>
        public Animator Follow
        {
            get { return follow; }
            set
            {
                Stop();
                follow = value;
            }
        }
        public int FollowedLayer { get { return followedLayer; } set { followedLayer = value; } }
        /// <summary>Turns all about the body, to the left; devices that do not go round it, or are not on both sides, stay.</summary>
        public float TurnDegrees { get { return turnDegrees; } set { turnDegrees = value; } }
        /// <summary>Raises all by metres; devices of one height stay.</summary>
        public float Raise { get { return raise; } set { raise = value; } }
        /// <summary>Multiplies heights about the middle of each device.</summary>
        public float Stretch { get { return stretch; } set { stretch = value; } }
        public float Speed { get { return speed; } set { speed = value; } }
        /// <summary>Whether the whole clip loops; set while a named clip plays, it applies to that, too.</summary>
        public bool Loop
        {
            get { return loop; }
            set
            {
                loop = isLooping = value;
                if (player != null) player.Loops = value;
            }
        }

        /// <summary>Begins again at the beginning. Gain, speed, factors and loop stay.</summary>
        public void Play() { Play(""); }

        /// <summary>
        /// Begins again with a named clip of the scene, which loops if it is meant to (empty: the whole clip).
        /// Gain, speed, factors and <see cref="Loop"/> stay; an unknown name is an error, and silence.
        /// </summary>
        public void Play(string name)
        {
            isHeld = false;
            if (!Prepare())
            {
                Debug.LogError("The haptic player has no clip.", this);
                return;
            }
            if (loop != isLooping) Loop = loop;
            if (player.Play(name)) return;
            Debug.LogError("The haptic clip has no part '" + name + "'.", this);
            Silence();
        }

        /// <summary>Stands still in silence, until it is called with false or something is played.</summary>
        public void Pause(bool pause)
        {
            isHeld = pause;
            Hold();
        }

        public void Stop()
        {
            followed = 0;
            if (player == null) return;
            player.Stop();
            Silence();
        }

        public void Seek(double seconds)
        {
            if (player != null) player.Seek(seconds);
        }

        /// <summary>Scales one parameter, say amplitude_m_s2; false: the clip has none of this name, or there is no clip.</summary>
        public bool SetParameter(string parameter, double factor)
        {
            return Prepare() && player.SetParameter(parameter, factor);
        }

        void OnEnable()
        {
            isUnfocused = !Application.isFocused;
            isPaused = false;
            if (playOnEnable && follow == null) Play();
        }

        void OnDisable() { Stop(); }

        void OnApplicationFocus(bool hasFocus)
        {
            isUnfocused = !hasFocus;
            Hold();
        }

        void OnApplicationPause(bool pause)
        {
            isPaused = pause;
            Hold();
        }

        void Hold()
        {
            if ((isHeld || isUnfocused || isPaused) && player != null) Silence();
        }

        void Update()
        {
            if (follow != null || !IsPlaying || isHeld || isUnfocused || isPaused) return;
            if (Time.timeScale == 0.0f)
            {
                Silence();
                return;
            }
            if (loop != isLooping) Loop = loop; // changed in the inspector
            player.Gain = gain;
            player.Place(turnDegrees, raise, stretch);
            player.Advance(Time.deltaTime * speed, values);
            Tell();
            if (player.IsPlaying) return;
            Silence();
            if (Finished != null) Finished();
        }

        /// <summary>The animator has moved on since Update.</summary>
        void LateUpdate()
        {
            if (follow == null || isHeld || isUnfocused || isPaused || !Prepare()) return;
            if (!follow.isActiveAndEnabled || follow.speed == 0.0f || Time.timeScale == 0.0f)
            {
                if (followed != 0) Silence();
                return;
            }
            AnimatorStateInfo state = follow.GetCurrentAnimatorStateInfo(followedLayer);
            if (state.shortNameHash != followed)
            {
                followed = state.shortNameHash;
                player.Play(NameOf(followed));
            }
            double turns = state.normalizedTime;
            double seconds = (state.loop ? turns - Math.Floor(turns) : Math.Min(turns, 1.0)) * state.length;
            player.Gain = gain;
            player.Place(turnDegrees, raise, stretch);
            player.Follow(seconds, state.loop ? state.length : 0.0, values);
            Tell();
        }

        /// <summary>The named clip of an animator's state; empty: none has its name.</summary>
        string NameOf(int hash)
        {
            foreach (NamedClip each in player.Clip.NamedClips)
                if (Animator.StringToHash(each.Name) == hash) return each.Name;
            return "";
        }

        /// <summary>Makes a player of the clip; false: there is no clip.</summary>
        bool Prepare()
        {
            if (clip == null) return false;
            if (player != null && player.Clip == clip.Clip) return true;
            player = new ClipPlayer(clip.Clip) { Loops = loop };
            isLooping = loop;
            values = new float[clip.Clip.Columns.Length];
            player.Neutral(values);
            return true;
        }

        void Silence()
        {
            player.Neutral(values);
            Tell();
        }

        void Tell()
        {
            if (ValuesChanged != null) ValuesChanged(this);
        }
    }
}
