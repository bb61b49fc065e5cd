// SPDX-License-Identifier: MIT
using System;
using System.Runtime.InteropServices;

namespace Hfx.Haptics
{
    /// <summary>
    /// A body of a clip that feels volumes and painted areas: the compiled core (hfx_haptics), of
    /// players/native. Needs nothing of Unity and makes no garbage. Matrices are 3 x 4, row after row.
    /// </summary>
    public sealed class LiveBody : IDisposable
    {
        const string Library = "hfx_haptics";

        IntPtr self;

        /// <summary>The clip of the body and its devices.</summary>
        public HapticClip Clip { get; private set; }
        /// <summary>The clip of the volumes and painted areas, often the same.</summary>
        public HapticClip EffectClip { get; private set; }
        public Body Body { get; private set; }

        /// <exception cref="FormatException">The core refuses the clip; the message says why.</exception>
        /// <exception cref="DllNotFoundException">The core was not compiled for this platform.</exception>
        /// <exception cref="EntryPointNotFoundException">The compiled core is older than this package.</exception>
        public LiveBody(HapticClip clip, int body) : this(clip, body, null) { }

        /// <summary>Feels the effects of another clip on a body of this one; null: those of the same.</summary>
        /// <exception cref="FormatException">The core refuses a clip; the message says why.</exception>
        /// <exception cref="DllNotFoundException">The core was not compiled for this platform.</exception>
        /// <exception cref="EntryPointNotFoundException">The compiled core is older than this package.</exception>
        public LiveBody(HapticClip clip, int body, HapticClip effects)
        {
            hfx_live_version();
            int error;
            byte[] others = effects != null ? effects.Bytes : null;
            self = hfx_live_open_effects(
                clip.Bytes, (UIntPtr)clip.Bytes.Length, (uint)body, others, (UIntPtr)(others != null ? others.Length : 0), out error);
            if (self == IntPtr.Zero) throw new FormatException(Marshal.PtrToStringAnsi(hfx_live_error(error)));
            Clip = clip;
            EffectClip = effects ?? clip;
            Body = clip.Bodies[body];
        }

        ~LiveBody() { Close(); }

        public void Dispose()
        {
            Close();
            GC.SuppressFinalize(this);
        }

        /// <summary>Poses the body: 12 numbers for each bone, rest space to world. Each frame.</summary>
        public bool SetBones(float[] matrices)
        {
            return hfx_live_set_bones(self, matrices, (uint)matrices.Length) == 0;
        }

        /// <summary>Places a volume: shape space to world.</summary>
        public bool SetVolume(int effect, float[] matrix)
        {
            return hfx_live_set_volume(self, (uint)effect, matrix, (uint)matrix.Length) == 0;
        }

        /// <summary>Changes a parameter of an effect (0: its strength), in its unit.</summary>
        public bool SetParameter(int effect, int parameter, double value)
        {
            return hfx_live_set_parameter(self, (uint)effect, (uint)parameter, value) == 0;
        }

        /// <summary>Turns an effect on at a factor of 0 (off) to 1 of its level in the clip.</summary>
        public bool Trigger(int effect, double factor)
        {
            return hfx_live_trigger(self, (uint)effect, factor) == 0;
        }

        /// <summary>
        /// Turns a painted area about the body's axis (degrees to the left), raises it by metres, and multiplies heights
        /// about its own middle. Takes as long as some frames; false: there is no such painted area.
        /// </summary>
        public bool Place(int effect, double degrees, double metres, double heights)
        {
            return hfx_live_place(self, (uint)effect, degrees, metres, heights) == 0;
        }

        /// <summary>
        /// Adds one more volume of an effect, off, with a contact response of its own; its number, which stands for
        /// an effect in all other methods, or -1: there is no such volume effect, or no memory.
        /// </summary>
        public int AddVolume(int effect) { return Math.Max(hfx_live_add_volume(self, (uint)effect), -1); }

        /// <summary>Removes a volume of <see cref="AddVolume"/>; false: there is none of this number.</summary>
        public bool RemoveVolume(int number) { return hfx_live_remove_volume(self, (uint)number) == 0; }

        /// <summary>What is felt now, the seconds since the last call on: one value for each column.</summary>
        public bool Evaluate(double seconds, float[] values)
        {
            return hfx_live_evaluate(self, seconds, values, (uint)values.Length) == 0;
        }

        /// <summary>Weights 0 to 1 of an effect at the vertices of its model; for looking at, it makes garbage.</summary>
        public float[] GetWeights(int effect)
        {
            float[] found = new float[hfx_live_weights(self, (uint)effect, null, 0)];
            hfx_live_weights(self, (uint)effect, found, (uint)found.Length);
            return found;
        }

        /// <summary>Level of an effect at the last evaluation: factor, level in the clip and response, multiplied.</summary>
        public double GetLevel(int effect) { return hfx_live_level(self, (uint)effect); }

        void Close()
        {
            hfx_live_close(self);
            self = IntPtr.Zero;
        }

        [DllImport(Library)] static extern uint hfx_live_version();
        [DllImport(Library)] static extern IntPtr hfx_live_open_effects(byte[] bytes, UIntPtr size, uint body, byte[] effects, UIntPtr effectsSize, out int error);
        [DllImport(Library)] static extern void hfx_live_close(IntPtr self);
        [DllImport(Library)] static extern IntPtr hfx_live_error(int error);
        [DllImport(Library)] static extern int hfx_live_set_bones(IntPtr self, float[] matrices, uint count);
        [DllImport(Library)] static extern int hfx_live_set_volume(IntPtr self, uint effect, float[] matrix, uint count);
        [DllImport(Library)] static extern int hfx_live_set_parameter(IntPtr self, uint effect, uint parameter, double value);
        [DllImport(Library)] static extern int hfx_live_trigger(IntPtr self, uint effect, double factor);
        [DllImport(Library)] static extern int hfx_live_place(IntPtr self, uint effect, double degrees, double metres, double heights);
        [DllImport(Library)] static extern int hfx_live_add_volume(IntPtr self, uint effect);
        [DllImport(Library)] static extern int hfx_live_remove_volume(IntPtr self, uint number);
        [DllImport(Library)] static extern int hfx_live_evaluate(IntPtr self, double seconds, float[] values, uint count);
        [DllImport(Library)] static extern uint hfx_live_weights(IntPtr self, uint effect, float[] found, uint count);
        [DllImport(Library)] static extern double hfx_live_level(IntPtr self, uint effect);
    }
}
