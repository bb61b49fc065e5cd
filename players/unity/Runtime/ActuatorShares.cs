// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;

namespace Hfx.Haptics
{
    /// <summary>Part that an actuator plays of another one's values.</summary>
    struct ActuatorShare
    {
        public int Actuator;
        public double Weight;
    }

    /// <summary>
    /// Where the values of actuators come from while a clip is turned about the body, raised or stretched:
    /// docs/formats/clip.md, "Turned and raised". Needs nothing of Unity.
    /// </summary>
    static class ActuatorShares
    {
        const double AxisY = -0.045; // metres: the vertical axis of the canonical body; x is 0
        const double LevelHeight = 0.01;

        /// <summary>Actuators of one modality of a device, about as high as each other.</summary>
        sealed class Level
        {
            public readonly List<Actuator> Actuators = new List<Actuator>();
            public double Low, High, Left, Right, Front, Back;
            int sides;

            public double Height { get { return 0.5 * (Low + High); } }
            public double X { get { return 0.5 * (Left + Right); } }
            public double Y { get { return 0.5 * (Front + Back); } }
            public bool IsRound { get { return sides == 6 || (Left <= 0.0 && Right >= 0.0 && Front <= AxisY && Back >= AxisY); } }

            public void Add(Actuator actuator)
            {
                bool isFirst = Actuators.Count == 0;
                if (isFirst) Low = actuator.CentreZ;
                High = actuator.CentreZ;
                if (isFirst || actuator.CentreX < Left) Left = actuator.CentreX;
                if (isFirst || actuator.CentreX > Right) Right = actuator.CentreX;
                if (isFirst || actuator.CentreY < Front) Front = actuator.CentreY;
                if (isFirst || actuator.CentreY > Back) Back = actuator.CentreY;
                sides |= 1 << (int)actuator.Side;
                Actuators.Add(actuator);
            }
        }

        /// <summary>For each actuator of a clip up to four, whose values it plays.</summary>
        public static ActuatorShare[][] Find(HapticClip clip, double turnDegrees, double raise, double stretch)
        {
            ActuatorShare[][] shares = new ActuatorShare[clip.Actuators.Length][];
            for (int k = 0; k < shares.Length; k++) shares[k] = new[] { new ActuatorShare { Actuator = k, Weight = 1.0 } };
            foreach (Device device in clip.Devices)
                foreach (Modality modality in Enum.GetValues(typeof(Modality)))
                {
                    List<Level> levels = Levels(clip, device, modality);
                    for (int own = 0; own < levels.Count; own++)
                    {
                        double middle = 0.5 * (levels[0].Height + levels[levels.Count - 1].Height);
                        double wanted = levels[own].Height;
                        if (levels.Count > 1) wanted = middle + (wanted - middle - raise) / stretch;
                        foreach (Actuator actuator in levels[own].Actuators)
                            shares[Array.IndexOf(clip.Actuators, actuator)] = Of(clip, levels, own, actuator, turnDegrees, wanted);
                    }
                }
            return shares;
        }

        static List<Level> Levels(HapticClip clip, Device device, Modality modality)
        {
            List<Actuator> sorted = new List<Actuator>();
            for (int k = device.FirstActuator; k < device.FirstActuator + device.Actuators; k++)
                if (clip.Actuators[k].Place != ActuatorPlace.Room && clip.Actuators[k].Modality == modality) sorted.Add(clip.Actuators[k]);
            sorted.Sort((one, other) => one.CentreZ.CompareTo(other.CentreZ));
            List<Level> levels = new List<Level>();
            foreach (Actuator actuator in sorted)
            {
                if (levels.Count == 0 || actuator.CentreZ > levels[levels.Count - 1].Low + LevelHeight) levels.Add(new Level());
                levels[levels.Count - 1].Add(actuator);
            }
            return levels;
        }

        /// <summary>Beyond the lowest and the highest level, values fall to neutral over the distance to the next level.</summary>
        static ActuatorShare[] Of(HapticClip clip, List<Level> levels, int own, Actuator actuator, double turnDegrees, double wanted)
        {
            List<ActuatorShare> found = new List<ActuatorShare>();
            for (int k = 0; k < levels.Count; k++)
            {
                double away = wanted - levels[k].Height, gap = double.PositiveInfinity;
                bool isBelow = k > 0 && (away < 0.0 || k + 1 == levels.Count);
                if (isBelow) gap = levels[k].Height - levels[k - 1].Height;
                else if (k + 1 < levels.Count) gap = levels[k + 1].Height - levels[k].Height;
                double weight = 1.0 - Math.Abs(away) / gap;
                if (!(weight > 0.0)) continue;
                if (k == own && (!levels[k].IsRound || turnDegrees == 0.0))
                    found.Add(new ActuatorShare { Actuator = Array.IndexOf(clip.Actuators, actuator), Weight = weight });
                else AddNeighbours(clip, levels[k], actuator, turnDegrees, weight, found);
            }
            return found.ToArray();
        }

        /// <summary>The one or two neighbours of an actuator's place, by angle where the level goes round, else by x.</summary>
        static void AddNeighbours(HapticClip clip, Level level, Actuator actuator, double turnDegrees, double weight, List<ActuatorShare> found)
        {
            bool isRound = level.IsRound;
            double at = isRound ? Angle(level, actuator) - turnDegrees : actuator.CentreX;
            double before = double.PositiveInfinity, after = double.PositiveInfinity;
            Actuator previous = null, next = null;
            foreach (Actuator each in level.Actuators)
            {
                double back = at - (isRound ? Angle(level, each) : each.CentreX), ahead = -back;
                if (isRound)
                {
                    back = Wrapped(back);
                    ahead = Wrapped(ahead);
                }
                if (back >= 0.0 && back < before)
                {
                    before = back;
                    previous = each;
                }
                if (ahead >= 0.0 && ahead < after)
                {
                    after = ahead;
                    next = each;
                }
            }
            double share = weight;
            if (previous != null && next != null && previous != next && before > 0.0) share = weight * after / (before + after);
            found.Add(new ActuatorShare { Actuator = Array.IndexOf(clip.Actuators, previous ?? next), Weight = share });
            if (weight - share > 0.0) found.Add(new ActuatorShare { Actuator = Array.IndexOf(clip.Actuators, next), Weight = weight - share });
        }

        static double Angle(Level level, Actuator of) { return Math.Atan2(of.CentreY - level.Y, of.CentreX - level.X) * 180.0 / Math.PI; }

        /// <summary>Degrees from 0 to below 360.</summary>
        public static double Wrapped(double degrees)
        {
            double within = degrees - 360.0 * Math.Floor(degrees / 360.0);
            return within < 360.0 ? within : 0.0;
        }
    }
}
