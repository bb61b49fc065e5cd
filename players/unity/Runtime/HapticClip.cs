// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.Text;

namespace Hfx.Haptics
{
    public enum Modality { Vibration, Pressure, Temperature, Wind }

    public enum Side { Any, Left, Right }

    /// <summary>What an actuator acts on: vertices of a model, a patch of skin, or the room.</summary>
    public enum ActuatorPlace { Vertices, Skin, Room }

    /// <summary>A device of a clip and the body that wears it.</summary>
    public sealed class Device
    {
        public string Id, Name, Body;
        public int FirstActuator, Actuators;
        /// <summary>Seconds without a new value after which an output falls silent by itself.</summary>
        public double DeadManSeconds;

        /// <summary>Whether this is a device of a name: empty is any, "glove" is glove, glove_left and glove_right.</summary>
        public bool IsNamed(string name)
        {
            if (name.Length == 0 || Id == name) return true;
            if (!Id.StartsWith(name, StringComparison.Ordinal)) return false;
            bool isLeft = Id.Length == name.Length + 5 && Id.EndsWith("_left", StringComparison.Ordinal);
            return isLeft || (Id.Length == name.Length + 6 && Id.EndsWith("_right", StringComparison.Ordinal));
        }
    }

    /// <summary>An actuator of a device; its first column is its strength.</summary>
    public sealed class Actuator
    {
        public string Id, Parts, Bone, HumanBone;
        public Modality Modality;
        public Side Side;
        public ActuatorPlace Place;
        /// <summary>On the canonical body, metres, in the clip's space; 0 where there is none.</summary>
        public float CentreX, CentreY, CentreZ;
        public int FirstColumn, Columns;
        public float UpdateIntervalMs, SlewPerSecond, MaximumOnSeconds, RestSeconds;
        internal int FirstRow, Rows, FirstValue;
    }

    /// <summary>One number that an actuator is told: a strength, a frequency, ...</summary>
    public sealed class Column
    {
        public string Parameter, Unit;
        public double Lowest, Highest, Neutral;
        internal int NeutralNumber;
    }

    /// <summary>A named part of a clip.</summary>
    public sealed class NamedClip
    {
        public string Name;
        public double StartSeconds, EndSeconds;
        public bool Loops;
    }

    /// <summary>A body of the spatial part, in the order in which the core numbers them.</summary>
    public sealed class Body
    {
        public string Name;
        public Bone[] Bones;
    }

    /// <summary>A bone by its names in the scene and in common rigs; these may be empty.</summary>
    public sealed class Bone
    {
        public string Name, Human, Mixamo, Unreal;
        /// <summary>Index within the body, below its own; -1: it has none.</summary>
        public int Parent;
        /// <summary>Whether skin of a model follows this bone.</summary>
        public bool HasSkin;
    }

    public enum VolumeShape { Cuboid, Sphere, Cylinder, Capsule }

    /// <summary>A volume or painted area of the spatial part.</summary>
    public sealed class Effect
    {
        public string Name;
        public bool IsPainted;
        public Modality Modality;
        public VolumeShape Shape;
        public float HalfSegment, Level;
        /// <summary>Shape space to the scene's world, in the clip's space: 3 x 4, row after row.</summary>
        public float[] Matrix;
    }

    /// <summary>
    /// A clip (.hfxclip), as docs/formats/clip.md describes it: what each actuator of each device plays
    /// over time, and the names of what avatars can feel. Needs nothing of Unity.
    /// </summary>
    public sealed class HapticClip
    {
        const int Version = 1;
        static readonly byte[] Magic = { 0x48, 0x46, 0x58, 0x43, 0x4C, 0x49, 0x50, 0x0A };
        static readonly Dictionary<string, int> RecordSizes = new Dictionary<string, int>
        {
            { "TEXT", 1 }, { "TIME", 24 }, { "DEVC", 32 }, { "ACTR", 88 }, { "COLM", 40 },
            { "ROWS", 4 }, { "VALU", 2 }, { "CLIP", 24 },
            { "BODY", 24 }, { "BONE", 72 }, { "MODL", 24 }, { "VERT", 24 }, { "WGHT", 4 }, { "EFCT", 128 },
            { "SURF", 32 }, { "HMAP", 32 }, { "TEXL", 4 },
        };

        readonly byte[] bytes;
        readonly Dictionary<string, Part> parts = new Dictionary<string, Part>();

        struct Part
        {
            public int Offset, Count;
        }

        public double RateHz { get; private set; }
        public int RowCount { get; private set; }
        public double Seconds { get { return RowCount / RateHz; } }
        public Device[] Devices { get; private set; }
        public Actuator[] Actuators { get; private set; }
        public Column[] Columns { get; private set; }
        public NamedClip[] NamedClips { get; private set; }
        public Body[] Bodies { get; private set; }
        public Effect[] Effects { get; private set; }
        public Surface[] Surfaces { get; private set; }
        internal byte[] Bytes { get { return bytes; } }

        /// <exception cref="FormatException">The bytes are no clip, damaged, or of a newer version.</exception>
        public HapticClip(byte[] bytes)
        {
            this.bytes = bytes;
            FindParts();
            ReadTables();
        }

        internal int NumberAt(int value)
        {
            int at = parts["VALU"].Offset + 2 * value;
            return bytes[at] | bytes[at + 1] << 8;
        }

        /// <summary>The entry of an actuator that holds at a row.</summary>
        internal int EntryAt(Actuator actuator, int row)
        {
            int low = 0, high = actuator.Rows;
            while (high - low > 1)
            {
                int middle = low + (high - low) / 2;
                if (RowAt(actuator.FirstRow + middle) <= row) low = middle;
                else high = middle;
            }
            return low;
        }

        void FindParts()
        {
            Demand(bytes != null && bytes.Length >= 24, "it is too short");
            for (int k = 0; k < Magic.Length; k++) Demand(bytes[k] == Magic[k], "it is no clip");
            Demand(U32(8) <= Version, "it is of version " + U32(8) + "; versions up to " + Version + " are read");
            long sections = U32(20);
            Demand(U32(12) == bytes.Length && sections <= 64 && 24 + 16 * sections <= bytes.Length, "it is cut off");
            Demand(U32(16) == Crc32(20), "its checksum is not that of its content");
            for (int k = 0; k < sections; k++)
            {
                int at = 24 + 16 * k;
                string name = Encoding.ASCII.GetString(bytes, at, 4);
                int size;
                if (!RecordSizes.TryGetValue(name, out size)) continue;
                long offset = U32(at + 4), length = U32(at + 8);
                Demand(offset % 8 == 0 && offset + length <= bytes.Length && length % size == 0, name + " does not fit");
                Demand(!parts.ContainsKey(name), name + " stands twice");
                parts[name] = new Part { Offset = (int)offset, Count = (int)(length / size) };
            }
            foreach (string name in RecordSizes.Keys)
                if (!parts.ContainsKey(name)) parts[name] = new Part();
            Demand(parts["TIME"].Count == 1 && parts["TEXT"].Count > 0, "TIME or TEXT is missing");
            Part text = parts["TEXT"];
            Demand(bytes[text.Offset + text.Count - 1] == 0, "TEXT does not end");
        }

        void ReadTables()
        {
            int time = parts["TIME"].Offset;
            RateHz = F64(time);
            Demand(RateHz > 0.0 && RateHz <= 1e6, "it has " + RateHz + " rows a second");
            long rows = U32(time + 16);
            Demand(rows <= int.MaxValue, "it has " + rows + " rows");
            RowCount = (int)rows;
            Columns = Records("COLM", ReadColumn);
            Actuators = Records("ACTR", ReadActuator);
            Devices = Records("DEVC", ReadDevice);
            NamedClips = Records("CLIP", ReadNamedClip);
            Bodies = Records("BODY", ReadBody);
            Effects = Records("EFCT", ReadEffect);
            Surfaces = Records("SURF", ReadSurface);
        }

        T[] Records<T>(string name, Func<int, T> read)
        {
            T[] found = new T[parts[name].Count];
            for (int k = 0; k < found.Length; k++) found[k] = read(parts[name].Offset + RecordSizes[name] * k);
            return found;
        }

        Column ReadColumn(int at)
        {
            Column column = new Column
            {
                Parameter = Text(at), Unit = Text(at + 4), NeutralNumber = Index(at + 12, 65536, "neutral"),
                Lowest = F64(at + 16), Highest = F64(at + 24), Neutral = F64(at + 32),
            };
            Demand(column.Lowest <= column.Neutral && column.Neutral <= column.Highest, "a column's limits are wrong");
            return column;
        }

        Actuator ReadActuator(int at)
        {
            Actuator found = new Actuator
            {
                Id = Text(at), Modality = (Modality)Index(at + 4, 4, "modality"),
                FirstColumn = Index(at + 8, Columns.Length, "column"), Columns = Index(at + 12, 9, "columns"),
                FirstRow = Index(at + 16, parts["ROWS"].Count, "row"), Rows = Index(at + 20, int.MaxValue, "rows"),
                FirstValue = Index(at + 24, parts["VALU"].Count, "value"), Side = (Side)Index(at + 32, 3, "side"),
                Parts = Text(at + 36), Bone = Text(at + 40), HumanBone = Text(at + 44),
                Place = (ActuatorPlace)Index(at + 28, 3, "place"),
                CentreX = F32(at + 48), CentreY = F32(at + 52), CentreZ = F32(at + 56),
                UpdateIntervalMs = F32(at + 68), SlewPerSecond = F32(at + 72),
                MaximumOnSeconds = F32(at + 76), RestSeconds = F32(at + 80),
            };
            Demand(found.Columns > 0 && found.FirstColumn + found.Columns <= Columns.Length, "an actuator's columns are not there");
            Demand(found.Rows > 0 && (long)found.FirstRow + found.Rows <= parts["ROWS"].Count, "an actuator's rows are not there");
            Demand(found.FirstValue + (long)found.Rows * found.Columns <= parts["VALU"].Count, "an actuator's values are not there");
            long before = -1;
            for (int k = 0; k < found.Rows; k++)
            {
                long row = RowAt(found.FirstRow + k);
                Demand(row > before && row < RowCount && (k > 0 || row == 0), "an actuator's rows are not in order");
                before = row;
            }
            return found;
        }

        Device ReadDevice(int at)
        {
            Device device = new Device
            {
                Id = Text(at), Name = Text(at + 4), Body = Text(at + 8),
                FirstActuator = Index(at + 12, Actuators.Length + 1, "actuator"),
                Actuators = Index(at + 16, Actuators.Length + 1, "actuators"), DeadManSeconds = U32(at + 28) / 1000.0,
            };
            Demand(device.FirstActuator + device.Actuators <= Actuators.Length, "a device's actuators are not there");
            return device;
        }

        NamedClip ReadNamedClip(int at)
        {
            return new NamedClip
            {
                Name = Text(at), Loops = U32(at + 4) == 1, StartSeconds = F64(at + 8), EndSeconds = F64(at + 16),
            };
        }

        Body ReadBody(int at)
        {
            int first = Index(at + 4, parts["BONE"].Count + 1, "bone"), count = Index(at + 8, 65536, "bones");
            Demand(first + count <= parts["BONE"].Count, "a body's bones are not there");
            Body body = new Body { Name = Text(at), Bones = new Bone[count] };
            for (int k = 0; k < count; k++)
            {
                int bone = parts["BONE"].Offset + RecordSizes["BONE"] * (first + k);
                bool isRoot = U32(bone + 16) == uint.MaxValue;
                body.Bones[k] = new Bone
                {
                    Name = Text(bone), Human = Text(bone + 4), Mixamo = Text(bone + 8), Unreal = Text(bone + 12),
                    Parent = isRoot ? -1 : Index(bone + 16, k, "parent"),
                };
            }
            MarkSkin(at, body.Bones);
            return body;
        }

        /// <summary>Marks the bones with a weight above 0 on a vertex of the body's models.</summary>
        void MarkSkin(int body, Bone[] bones)
        {
            int models = Index(body + 16, parts["MODL"].Count + 1L, "models");
            int first = Index(body + 12, parts["MODL"].Count - models + 1L, "model");
            Part vertex = parts["VERT"], weight = parts["WGHT"];
            for (int k = parts["MODL"].Offset + 24 * first; models > 0; k += 24, models--)
            {
                int vertices = Index(k + 16, vertex.Count + 1L, "vertices");
                int at = vertex.Offset + 24 * Index(k + 12, vertex.Count - vertices + 1L, "vertex");
                for (; vertices > 0; at += 24, vertices--)
                {
                    int weights = Index(at + 20, weight.Count + 1L, "weights");
                    int of = weight.Offset + 4 * Index(at + 16, weight.Count - weights + 1L, "weight");
                    for (; weights > 0; of += 4, weights--)
                    {
                        int bone = bytes[of] | bytes[of + 1] << 8;
                        Demand(bone < bones.Length, "a bone of the skin is not there");
                        if ((bytes[of + 2] | bytes[of + 3]) != 0) bones[bone].HasSkin = true;
                    }
                }
            }
        }

        Effect ReadEffect(int at)
        {
            float[] matrix = new float[12];
            for (int k = 0; k < 12; k++) matrix[k] = F32(at + 76 + 4 * k);
            return new Effect
            {
                Name = Text(at), IsPainted = Index(at + 4, 2, "kind") == 1, Modality = (Modality)Index(at + 8, 4, "modality"),
                Shape = (VolumeShape)Index(at + 20, 4, "shape"), HalfSegment = F32(at + 24), Level = F32(at + 36), Matrix = matrix,
            };
        }

        Surface ReadSurface(int at)
        {
            int map = parts["HMAP"].Offset + RecordSizes["HMAP"] * Index(at + 4, parts["HMAP"].Count, "map");
            Surface found = new Surface
            {
                Name = Text(at), Columns = Index(map, 65536, "columns"), Rows = Index(map + 4, 65536, "rows"),
                WidthMm = F32(map + 8), HeightMm = F32(map + 12), Tiles = U32(map + 16) == 1,
                LowestAmplitude = F32(at + 8), HighestAmplitude = F32(at + 12), LowestHz = F32(at + 16), HighestHz = F32(at + 20),
                UvWidthMm = F32(at + 24), UvHeightMm = F32(at + 28),
                Texels = parts["TEXL"].Offset + 4 * Index(map + 20, parts["TEXL"].Count, "texel"),
            };
            long texels = (long)found.Columns * found.Rows;
            Demand(texels > 0 && U32(map + 20) + texels <= parts["TEXL"].Count, "a surface's texels are not there");
            return found;
        }

        internal uint TexelAt(Surface surface, int number) { return (uint)U32(surface.Texels + 4 * number); }

        long RowAt(int index) { return U32(parts["ROWS"].Offset + 4 * index); }

        int Index(int at, long limit, string what)
        {
            long value = U32(at);
            Demand(value < limit, "the " + what + " " + value + " is not there");
            return (int)value;
        }

        string Text(int at)
        {
            Part text = parts["TEXT"];
            int begin = text.Offset + Index(at, text.Count, "text");
            int end = Array.IndexOf(bytes, (byte)0, begin);
            return Encoding.UTF8.GetString(bytes, begin, end - begin);
        }

        long U32(int at) { return (uint)(bytes[at] | bytes[at + 1] << 8 | bytes[at + 2] << 16 | bytes[at + 3] << 24); }

        float F32(int at) { return BitConverter.ToSingle(bytes, at); }

        double F64(int at)
        {
            double value = BitConverter.ToDouble(bytes, at);
            Demand(!double.IsNaN(value) && !double.IsInfinity(value), "a number is not finite");
            return value;
        }

        long Crc32(int from)
        {
            uint[] table = new uint[256];
            for (uint number = 0; number < 256; number++)
            {
                uint value = number;
                for (int bit = 0; bit < 8; bit++) value = (value & 1) != 0 ? value >> 1 ^ 0xEDB88320u : value >> 1;
                table[number] = value;
            }
            uint crc = 0xFFFFFFFFu;
            for (int k = from; k < bytes.Length; k++) crc = crc >> 8 ^ table[(crc ^ bytes[k]) & 0xFF];
            return crc ^ 0xFFFFFFFFu;
        }

        static void Demand(bool holds, string fault)
        {
            if (!holds) throw new FormatException("The haptic clip cannot be played: " + fault + ".");
        }
    }
}
