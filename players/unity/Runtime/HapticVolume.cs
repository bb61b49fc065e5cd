// SPDX-License-Identifier: MIT
using System.Collections.Generic;
using UnityEngine;

namespace Hfx.Haptics
{
    /// <summary>The inspector offers the names of volume effects for this text.</summary>
    public sealed class EffectNameAttribute : PropertyAttribute { }

    /// <summary>
    /// A volume of a clip in the game's world, felt by every <see cref="HapticBody"/> that it meets
    /// while it is enabled. Any number of volumes may have the same effect: each has a contact response of its own,
    /// and all are felt. Its shape has unit size, as in Blender: scale the transform.
    /// </summary>
    [AddComponentMenu("Haptics/Haptic Volume")]
    public sealed class HapticVolume : MonoBehaviour
    {
        internal static readonly List<HapticVolume> All = new List<HapticVolume>();

        /// <summary>Name of the effect in the clip.</summary>
        [SerializeField, EffectName] string effect = "";
        /// <summary>Factor of the effect's own level in the clip, 0 (off) to 1.</summary>
        [SerializeField, Range(0.0f, 1.0f)] float level = 1.0f;
        /// <summary>What the editor draws; what is felt has the shape in the clip.</summary>
        [SerializeField] VolumeShape shape = VolumeShape.Sphere;
        [SerializeField] float halfSegment = 1.0f;

        public string Effect { get { return effect; } set { effect = value; } }
        public float Level { get { return level; } set { level = value; } }
        public VolumeShape Shape { get { return shape; } set { shape = value; } }
        public float HalfSegment { get { return halfSegment; } set { halfSegment = value; } }

        void OnEnable() { All.Add(this); }

        void OnDisable() { All.Remove(this); }

        void OnDrawGizmos()
        {
            Gizmos.color = new Color(1.0f, 0.55f, 0.35f);
            Gizmos.matrix = transform.localToWorldMatrix;
            if (shape == VolumeShape.Cuboid)
            {
                Gizmos.DrawWireCube(Vector3.zero, 2.0f * Vector3.one);
                return;
            }
            // The axis of cylinders and capsules is Blender's Z, Unity's Y.
            float half = shape == VolumeShape.Sphere ? 0.0f : shape == VolumeShape.Cylinder ? 1.0f : halfSegment;
            Vector3 end = half * Vector3.up;
            if (shape != VolumeShape.Cylinder) Gizmos.DrawWireSphere(end, 1.0f);
            if (shape == VolumeShape.Capsule) Gizmos.DrawWireSphere(-end, 1.0f);
            if (half == 0.0f) return;
            const int Steps = 16;
            for (int k = 0; k < Steps; k++)
            {
                Vector3 one = OnCircle(k, Steps), next = OnCircle(k + 1, Steps);
                Gizmos.DrawLine(one + end, next + end);
                Gizmos.DrawLine(one - end, next - end);
                if (k % 4 == 0) Gizmos.DrawLine(one - end, one + end);
            }
        }

        static Vector3 OnCircle(int step, int steps)
        {
            float angle = 2.0f * Mathf.PI * step / steps;
            return new Vector3(Mathf.Cos(angle), 0.0f, Mathf.Sin(angle));
        }
    }
}
