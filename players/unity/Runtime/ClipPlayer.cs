// SPDX-License-Identifier: MIT
using System;

namespace Hfx.Haptics
{
    /// <summary>
    /// Plays a clip: of each actuator the strongest row since the last call. Rows hold, nothing is
    /// interpolated. Needs nothing of Unity and makes no garbage.
    /// </summary>
    public sealed class ClipPlayer
    {
        const double LongestStep = 0.5; // seconds of an animation
        const double Early = 1e-6; // of a row: times of frames are sums, and rounded

        readonly double[] factors; // of each column
        double start, end, turnDegrees, raise, stretch = 1.0;
        ActuatorShare[][] shares; // of each actuator; null: nothing is turned, raised or stretched
        int shownRow;
        bool loops, loopsWhole; // what plays now; the whole clip

        public HapticClip Clip { get; private set; }
        public bool IsPlaying { get; private set; }
        /// <summary>Stands still, in silence.</summary>
        public bool IsPaused { get; set; }
        /// <summary>Whether what plays now begins again at its end. Set, it applies to the whole clip, too.</summary>
        public bool Loops { get { return loops; } set { loops = loopsWhole = value; } }
        /// <summary>Scales how far all strengths are from neutral; below 0 and NaN count as 0.</summary>
        public double Gain { get; set; }
        /// <summary>Seconds from the beginning of the clip.</summary>
        public double Position { get; private set; }

        public ClipPlayer(HapticClip clip)
        {
            Clip = clip;
            factors = new double[clip.Columns.Length];
            Reset();
        }

        /// <summary>Begins again at the beginning. Gain, factors and loop stay, a pause ends.</summary>
        public void Play() { Begin(0.0, Clip.Seconds, loopsWhole); }

        /// <summary>
        /// Begins again with a named clip, which loops if it is meant to (null or empty: the whole clip). Gain, factors
        /// and the loop of the whole clip stay; false: there is no such name, and silence.
        /// </summary>
        public bool Play(string name)
        {
            if (string.IsNullOrEmpty(name))
            {
                Play();
                return true;
            }
            foreach (NamedClip each in Clip.NamedClips)
            {
                if (each.Name != name) continue;
                Begin(each.StartSeconds, each.EndSeconds, each.Loops);
                return true;
            }
            Begin(0.0, 0.0, false);
            return false;
        }

        /// <summary>
        /// Turns all about the body (degrees to the left, seen from above counterclockwise), raises it by metres, and
        /// multiplies heights about the middle of each device; 0, 0, 1 as made. Only devices that go round the body, or
        /// are on both sides of it, are turned. Makes garbage where something changes; what is no number counts as made.
        /// </summary>
        public void Place(double degrees, double metres, double heights)
        {
            degrees = Finite(degrees) ? ActuatorShares.Wrapped(degrees) : 0.0;
            metres = Finite(metres) ? metres : 0.0;
            heights = Finite(heights) && heights > 0.0 ? heights : 1.0;
            if (degrees == turnDegrees && metres == raise && heights == stretch) return;
            turnDegrees = degrees;
            raise = metres;
            stretch = heights;
            bool isPlain = turnDegrees == 0.0 && raise == 0.0 && stretch == 1.0;
            shares = isPlain ? null : ActuatorShares.Find(Clip, turnDegrees, raise, stretch);
        }

        static bool Finite(double value) { return !double.IsNaN(value) && !double.IsInfinity(value); }

        /// <summary>Gain and factors of 1, no loop, as made, silence.</summary>
        public void Reset()
        {
            Gain = 1.0;
            for (int k = 0; k < factors.Length; k++) factors[k] = 1.0;
            loopsWhole = false;
            Place(0.0, 0.0, 1.0);
            Begin(0.0, 0.0, false);
        }

        /// <summary>Ends in silence, at the beginning of what was played.</summary>
        public void Stop()
        {
            IsPlaying = false;
            Seek(start);
        }

        /// <summary>Jumps; what lies between is not felt.</summary>
        public void Seek(double seconds)
        {
            Position = Math.Min(Math.Max(Positive(seconds), start), end);
            shownRow = RowOf(Position) - 1;
        }

        /// <summary>
        /// Scales one parameter (amplitude_m_s2, frequency_hz, pressure_kpa, temperature_c, speed_m_s):
        /// its deviation from neutral, a frequency itself; false: no column has it.
        /// </summary>
        public bool SetParameter(string parameter, double factor)
        {
            bool found = false;
            for (int k = 0; k < factors.Length; k++)
            {
                if (Clip.Columns[k].Parameter != parameter) continue;
                factors[k] = Positive(factor);
                found = true;
            }
            return found;
        }

        /// <summary>Goes on by the seconds since the last call.</summary>
        /// <param name="values">One value for each column, in its unit.</param>
        public void Advance(double seconds, float[] values)
        {
            if (!IsPlaying || IsPaused)
            {
                Neutral(values);
                return;
            }
            Position += Positive(seconds);
            int first = shownRow + 1, now = RowOf(Position), again = 0, last = -1;
            int until = now;
            if (Position < end)
            {
                first = Math.Min(first, now);
            }
            else if (loops)
            {
                double past = Position - end, length = end - start;
                Position = start + past % length;
                now = RowOf(Position);
                again = RowOf(start);
                last = past < length ? now : RowOf(end);
            }
            else
            {
                Stop();
                Position = end;
                if (first > now) // all of it has been felt
                {
                    Neutral(values);
                    return;
                }
            }
            shownRow = now;
            for (int k = 0; k < Clip.Actuators.Length; k++)
            {
                Actuator actuator = Clip.Actuators[k];
                if (shares != null)
                {
                    Placed(actuator, shares[k], first, until, again, last, values);
                    continue;
                }
                int strongest = Strongest(actuator, first, until, again, last);
                for (int c = 0; c < actuator.Columns; c++)
                {
                    int column = actuator.FirstColumn + c;
                    values[column] = (float)Scaled(column, Decoded(column, Clip.NumberAt(strongest + c)), c == 0);
                }
            }
        }

        /// <summary>
        /// Goes to where an animation is that what plays belongs to. What lies between is felt; a step back, or one of
        /// more than half a second, is a jump.
        /// </summary>
        /// <param name="seconds">From the beginning of what plays.</param>
        /// <param name="loopSeconds">Length of an animation that loops; 0: it does not.</param>
        /// <param name="values">One value for each column, in its unit.</param>
        public void Follow(double seconds, double loopSeconds, float[] values)
        {
            double length = end - start, passed = start + Positive(seconds) - Position;
            loops = length > 0.0 && Math.Abs(loopSeconds - length) < 0.001 * length; // else it ends before or with the animation
            if (loops && passed < 0.0) passed += length; // it has begun again
            if (!IsPlaying && passed >= 0.0) // it is over before the animation is
            {
                Neutral(values);
                return;
            }
            IsPlaying = length > 0.0;
            if (passed < 0.0 || passed > LongestStep)
            {
                Seek(start + Positive(seconds));
                passed = 0.0;
            }
            Advance(passed, values);
        }

        /// <summary>What each column gives while nothing is felt.</summary>
        public void Neutral(float[] values)
        {
            for (int k = 0; k < Clip.Columns.Length; k++) values[k] = (float)Clip.Columns[k].Neutral;
        }

        void Begin(double from, double to, bool again)
        {
            start = from;
            end = to;
            loops = again;
            IsPaused = false;
            IsPlaying = end > start;
            Seek(start);
        }

        int RowOf(double seconds)
        {
            double last = Math.Max(Math.Ceiling(end * Clip.RateHz - Early) - 1.0, 0.0);
            double first = Math.Min(Math.Max(Math.Floor(start * Clip.RateHz + Early), 0.0), last);
            return (int)Math.Min(Math.Max(Math.Floor(seconds * Clip.RateHz + Early), first), last);
        }

        /// <summary>The values of other actuators, by shares; frequency and direction of the largest.</summary>
        void Placed(Actuator actuator, ActuatorShare[] from, int first, int until, int again, int last, float[] values)
        {
            double sum = 0.0, most = -1.0;
            Actuator main = null;
            int at = 0;
            for (int k = 0; k < from.Length; k++)
            {
                Actuator source = Clip.Actuators[from[k].Actuator];
                int strongest = Strongest(source, first, until, again, last);
                double away = Decoded(source.FirstColumn, Clip.NumberAt(strongest)) - Clip.Columns[source.FirstColumn].Neutral;
                away *= from[k].Weight;
                sum += away;
                if (!(Math.Abs(away) > most)) continue;
                most = Math.Abs(away);
                main = source;
                at = strongest;
            }
            for (int k = 0; k < actuator.Columns; k++)
            {
                Column column = Clip.Columns[actuator.FirstColumn + k];
                double value = k == 0 ? column.Neutral + sum : column.Neutral;
                if (k > 0 && main != null && k < main.Columns) value = Decoded(main.FirstColumn + k, Clip.NumberAt(at + k));
                value = Scaled(actuator.FirstColumn + k, value, k == 0);
                values[actuator.FirstColumn + k] = (float)Math.Min(Math.Max(value, column.Lowest), column.Highest);
            }
        }

        /// <summary>
        /// The strongest row's first value, of the rows of two spans, both ends included; a span that ends before it
        /// begins is none.
        /// </summary>
        int Strongest(Actuator actuator, int first, int until, int again, int last)
        {
            int neutral = Clip.Columns[actuator.FirstColumn].NeutralNumber;
            int strongest = actuator.FirstValue, farthest = 0;
            for (int span = 0; span < 2; span++)
            {
                int from = span == 0 ? first : again, to = span == 0 ? until : last;
                if (from > to) continue;
                int end = Clip.EntryAt(actuator, to);
                for (int entry = Clip.EntryAt(actuator, from); entry <= end; entry++)
                {
                    int value = actuator.FirstValue + entry * actuator.Columns;
                    int away = Math.Abs(Clip.NumberAt(value) - neutral);
                    if (away < farthest) continue;
                    farthest = away;
                    strongest = value;
                }
            }
            return strongest;
        }

        double Decoded(int index, int number)
        {
            Column column = Clip.Columns[index];
            if (number == column.NeutralNumber) return column.Neutral;
            return column.Lowest + (column.Highest - column.Lowest) * number / 65535.0;
        }

        double Scaled(int index, double value, bool isStrength)
        {
            Column column = Clip.Columns[index];
            double neutral = isStrength ? column.Neutral : 0.0;
            double scale = isStrength ? Positive(Gain) * factors[index] : factors[index];
            if (scale == 1.0) return value;
            return Math.Min(Math.Max(neutral + scale * (value - neutral), column.Lowest), column.Highest);
        }

        static double Positive(double value) { return value > 0.0 ? Math.Min(value, float.MaxValue) : 0.0; }
    }
}
