// SPDX-License-Identifier: MIT
using System;

namespace Hfx.Haptics
{
    /// <summary>A haptic surface of a clip with its map; peak amplitudes in m/s².</summary>
    public sealed class Surface
    {
        public string Name;
        public int Columns, Rows;
        /// <summary>Size of the map: u and v from 0 to 1.</summary>
        public float WidthMm, HeightMm;
        /// <summary>Size of 1 in the texture coordinates of the object in the scene; 0: it has none.</summary>
        public float UvWidthMm, UvHeightMm;
        /// <summary>Whether the map repeats beyond 0 to 1; else its border goes on.</summary>
        public bool Tiles;
        /// <summary>At intensity just above 0, and at 1.</summary>
        public float LowestAmplitude, HighestAmplitude;
        /// <summary>At sharpness 0 and 1.</summary>
        public float LowestHz, HighestHz;
        internal int Texels; // byte of the first
    }

    /// <summary>
    /// A finger on a surface: the strongest texel on its path from place to place, without sampling.
    /// Needs nothing of Unity and makes no garbage.
    /// </summary>
    public sealed class SurfaceStroke
    {
        const double RestMmPerSecond = 0.1, MostTiles = 4.0, Farthest = 1e6;

        readonly HapticClip clip;
        Surface surface;
        bool isTouching;
        double u, v;
        uint strongest;
        int number;

        /// <summary>Another surface begins a new touch; null: nothing is felt.</summary>
        public Surface Surface
        {
            get { return surface; }
            set
            {
                if (value != surface) Lift();
                surface = value;
            }
        }

        /// <summary>Peak amplitude, m/s².</summary>
        public float Amplitude { get; private set; }
        public float FrequencyHz { get; private set; }
        /// <summary>Of the texel that plays, 0 (rough) to 1.</summary>
        public float Sharpness { get { return (strongest & 255u) / 255.0f; } }

        public SurfaceStroke(HapticClip clip) { this.clip = clip; }

        /// <summary>Ends the touch.</summary>
        public void Lift()
        {
            isTouching = false;
            Amplitude = 0.0f;
        }

        /// <summary>
        /// Moves the finger to a place, some seconds after the last call: shares of the map's width and height from
        /// its lower left corner. The first call of a touch, and a resting finger, are silent.
        /// </summary>
        /// <param name="speed">Relative to the material, mm/s; below 0: that of the path.</param>
        public void Feel(double newU, double newV, double speed, double seconds)
        {
            Amplitude = FrequencyHz = 0.0f;
            bool isPlace = Math.Abs(newU) <= Farthest && Math.Abs(newV) <= Farthest; // false for NaN
            if (surface == null || !isPlace)
            {
                Lift();
                return;
            }
            bool isMoving = isTouching;
            double wayU = isTouching ? newU - u : 0.0, wayV = isTouching ? newV - v : 0.0;
            double x = wayU * surface.WidthMm, y = wayV * surface.HeightMm;
            if (speed >= 0.0) isMoving &= speed > RestMmPerSecond;
            else isMoving &= Math.Sqrt(x * x + y * y) > RestMmPerSecond * (seconds > 0.0 ? seconds : 0.0);
            double tiles = Math.Max(Math.Abs(wayU), Math.Abs(wayV));
            if (tiles > MostTiles) // only the end of a path that is too long
            {
                wayU *= MostTiles / tiles;
                wayV *= MostTiles / tiles;
            }
            isTouching = true;
            u = newU;
            v = newV;
            Cross((u - wayU) * surface.Columns, (v - wayV) * surface.Rows, u * surface.Columns, v * surface.Rows);
            uint intensity = strongest >> 8;
            if (isMoving && intensity > 0)
                Amplitude = (float)(surface.LowestAmplitude + ((double)surface.HighestAmplitude - surface.LowestAmplitude) * intensity / 16777215.0);
            FrequencyHz = (float)(surface.LowestHz + ((double)surface.HighestHz - surface.LowestHz) * (strongest & 255u) / 255.0);
        }

        /// <summary>Finds the strongest texel on a straight path, given in texels.</summary>
        void Cross(double beginX, double beginY, double endX, double endY)
        {
            strongest = 0;
            number = int.MaxValue;
            Meet(Math.Floor(beginX), Math.Floor(beginY));
            for (int axis = 0; axis < 2; axis++)
            {
                double begin = axis == 0 ? beginX : beginY, beginAcross = axis == 0 ? beginY : beginX;
                double end = axis == 0 ? endX : endY, across = (axis == 0 ? endY : endX) - beginAcross;
                double way = end - begin, first = Math.Floor(begin), step = way < 0.0 ? -1.0 : 1.0;
                double crossed = Math.Abs(Math.Floor(end) - first);
                for (double line = 1.0; line <= crossed; line += 1.0)
                {
                    // Rightwards line first + 1 comes first; leftwards the line first itself.
                    double share = (first - begin + (way < 0.0 ? 1.0 : 0.0) + step * line) / way;
                    double along = first + step * line, other = Math.Floor(beginAcross + share * across);
                    Meet(axis == 0 ? along : other, axis == 0 ? other : along);
                }
            }
        }

        /// <summary>Keeps the stronger texel, of equal ones that of the lower number.</summary>
        void Meet(double column, double row)
        {
            int there = Cell(row, surface.Rows) * surface.Columns + Cell(column, surface.Columns);
            uint texel = clip.TexelAt(surface, there), intensity = texel >> 8, best = strongest >> 8;
            if (intensity < best || (intensity == best && there >= number)) return;
            strongest = texel;
            number = there;
        }

        int Cell(double cell, int count)
        {
            if (surface.Tiles) cell -= count * Math.Floor(cell / count);
            return (int)Math.Min(Math.Max(cell, 0.0), count - 1.0);
        }
    }
}
