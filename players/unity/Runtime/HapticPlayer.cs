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

        ClipPlayer player;
        float[] values;
        bool isPaused, isAway; // by the game; because the application is paused or has lost its focus

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
        public float Gain { get { return gain; } set { gain = value; } }
        public bool Loop { get { return loop; } set { loop = value; } }

        /// <summary>Begins at the beginning.</summary>
        public void Play()
        {
            if (Prepare()) player.Play();
        }

        /// <summary>Begins with a named clip of the scene, which loops if it is meant to.</summary>
        public void Play(string name)
        {
            if (!Prepare()) return;
            if (player.Play(name)) loop = player.Loops;
            else Debug.LogError("The haptic clip has no part '" + name + "'.", this);
        }

        public void Pause(bool pause)
        {
            isPaused = pause;
            Hold();
        }

        public void Stop()
        {
            if (player == null) return;
            player.Stop();
            Silence();
        }

        public void Seek(double seconds)
        {
            if (player != null) player.Seek(seconds);
        }

        public bool SetParameter(string parameter, double factor)
        {
            return player != null && player.SetParameter(parameter, factor);
        }

        void OnEnable()
        {
            if (playOnEnable) Play();
        }

        void OnDisable() { Stop(); }

        void OnApplicationFocus(bool hasFocus)
        {
            isAway = !hasFocus;
            Hold();
        }

        void OnApplicationPause(bool pause)
        {
            isAway = pause;
            Hold();
        }

        void Hold()
        {
            if ((isPaused || isAway) && player != null) Silence();
        }

        void Update()
        {
            if (!IsPlaying || isPaused || isAway) return;
            if (Time.timeScale == 0.0f)
            {
                Silence();
                return;
            }
            player.Gain = gain;
            player.Loops = loop;
            player.Advance(Time.deltaTime, values);
            Tell();
            if (player.IsPlaying) return;
            Silence();
            if (Finished != null) Finished();
        }

        bool Prepare()
        {
            isPaused = false;
            if (clip == null)
            {
                Debug.LogError("The haptic player has no clip.", this);
                return false;
            }
            if (player == null || player.Clip != clip.Clip)
            {
                player = new ClipPlayer(clip.Clip);
                values = new float[clip.Clip.Columns.Length];
            }
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
