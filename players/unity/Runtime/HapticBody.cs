// SPDX-License-Identifier: MIT
using System;
using UnityEngine;

namespace Hfx.Haptics
{
    /// <summary>
    /// Lets an avatar feel <see cref="HapticVolume"/> components and painted areas of a clip, on its
    /// own moves. It stands on the root of the avatar whose rest pose is that of the body in the clip,
    /// and takes that pose when it wakes, before the animator moves anything. All is neutral while the game is
    /// paused or has lost its focus. Needs the compiled core.
    /// </summary>
    [AddComponentMenu("Haptics/Haptic Body")]
    public sealed class HapticBody : MonoBehaviour
    {
        [SerializeField] HapticClipAsset clip;
        /// <summary>For bones that are found by no name, of a humanoid avatar; may be empty.</summary>
        [SerializeField] Animator animator;
        /// <summary>The body of the clip; empty: its first.</summary>
        [SerializeField] string body = "";

        LiveBody core;
        Transform[] bones; // for each bone of the clip; null: as its parent
        Matrix4x4[] fromRest; // the clip's rest space to the bone, at rest
        float[] matrices, matrix, values;
        bool isSilent;

        /// <summary>Each frame, and once more when it is disabled: all columns, in their units.</summary>
        public event Action<HapticBody> ValuesChanged;

        public HapticClip Clip { get { return clip != null ? clip.Clip : null; } }
        public float[] Values { get { return values; } }
        /// <summary>The core; null where it or the clip is missing.</summary>
        public LiveBody Core { get { return core; } }

        /// <summary>The clip's space (metres, right-handed, Z up) to Unity's.</summary>
        public static Matrix4x4 ToUnity
        {
            get
            {
                Matrix4x4 found = Matrix4x4.zero;
                found.m00 = -1.0f;
                found.m12 = 1.0f;
                found.m21 = -1.0f;
                found.m33 = 1.0f;
                return found;
            }
        }

        /// <summary>Turns a painted area on at a level of 0 (off) to 1; false: there is none of this name.</summary>
        public bool Trigger(string effect, float level)
        {
            bool found = false;
            for (int k = 0; core != null && k < core.Clip.Effects.Length; k++)
                if (core.Clip.Effects[k].Name == effect) found |= core.Trigger(k, level);
            return found;
        }

        void Awake()
        {
            string fault = Open();
            if (fault.Length > 0) Debug.LogError("The haptic body feels nothing: " + fault, this);
        }

        void OnDestroy()
        {
            if (core != null) core.Dispose();
            core = null;
        }

        void OnDisable() { Silence(); }

        void OnApplicationFocus(bool hasFocus) { Pause(!hasFocus); }

        void OnApplicationPause(bool isPaused) { Pause(isPaused); }

        void Pause(bool isPaused)
        {
            isSilent = isPaused;
            if (isPaused) Silence();
        }

        void Silence()
        {
            if (core == null) return;
            for (int k = 0; k < values.Length; k++) values[k] = (float)core.Clip.Columns[k].Neutral;
            Tell();
        }

        void LateUpdate()
        {
            if (core == null || isSilent) return;
            if (Time.timeScale == 0.0f)
            {
                Silence();
                return;
            }
            Pose();
            Place();
            core.Evaluate(Time.deltaTime, values);
            Tell();
        }

        string Open()
        {
            if (clip == null) return "choose a clip.";
            int number = -1;
            Body[] bodies = clip.Clip.Bodies;
            for (int k = bodies.Length - 1; k >= 0; k--)
                if (body.Length == 0 || bodies[k].Name == body) number = k;
            if (number < 0) return "the clip has no body of this name; it has " + bodies.Length + ".";
            try
            {
                core = new LiveBody(clip.Clip, number);
            }
            catch (DllNotFoundException)
            {
                return "the compiled core is not there (build it with players/native/build.py).";
            }
            catch (FormatException fault)
            {
                return fault.Message;
            }
            values = new float[clip.Clip.Columns.Length];
            matrix = new float[12];
            return FindBones() ? "" : "no bone of the avatar has a known name.";
        }

        bool FindBones()
        {
            Bone[] wanted = core.Body.Bones;
            Transform[] there = GetComponentsInChildren<Transform>();
            Matrix4x4 toRoot = transform.worldToLocalMatrix;
            bones = new Transform[wanted.Length];
            fromRest = new Matrix4x4[wanted.Length];
            matrices = new float[12 * wanted.Length];
            bool isAny = false;
            for (int k = 0; k < wanted.Length; k++)
            {
                bones[k] = BoneNames.Find(wanted[k], there, animator);
                if (bones[k] == null) continue;
                fromRest[k] = (toRoot * bones[k].localToWorldMatrix).inverse * ToUnity;
                isAny = true;
            }
            return isAny;
        }

        void Pose()
        {
            Matrix4x4 root = transform.localToWorldMatrix * ToUnity;
            for (int k = 0; k < bones.Length; k++)
            {
                int parent = core.Body.Bones[k].Parent;
                if (bones[k] != null) Write(bones[k].localToWorldMatrix * fromRest[k], matrices, 12 * k);
                else if (parent < 0) Write(root, matrices, 12 * k);
                else Array.Copy(matrices, 12 * parent, matrices, 12 * k, 12);
            }
            core.SetBones(matrices);
        }

        /// <summary>Volumes of which there is no component are off.</summary>
        void Place()
        {
            Matrix4x4 toUnity = ToUnity;
            for (int k = 0; k < core.Clip.Effects.Length; k++)
            {
                if (core.Clip.Effects[k].IsPainted) continue;
                HapticVolume volume = VolumeOf(core.Clip.Effects[k].Name);
                core.Trigger(k, volume != null ? volume.Level : 0.0);
                if (volume == null) continue;
                Write(volume.transform.localToWorldMatrix * toUnity, matrix, 0);
                core.SetVolume(k, matrix);
            }
        }

        static HapticVolume VolumeOf(string effect)
        {
            for (int k = 0; k < HapticVolume.All.Count; k++)
                if (HapticVolume.All[k].Effect == effect) return HapticVolume.All[k];
            return null;
        }

        static void Write(Matrix4x4 from, float[] rows, int at)
        {
            rows[at] = from.m00;
            rows[at + 1] = from.m01;
            rows[at + 2] = from.m02;
            rows[at + 3] = from.m03;
            rows[at + 4] = from.m10;
            rows[at + 5] = from.m11;
            rows[at + 6] = from.m12;
            rows[at + 7] = from.m13;
            rows[at + 8] = from.m20;
            rows[at + 9] = from.m21;
            rows[at + 10] = from.m22;
            rows[at + 11] = from.m23;
        }

        void Tell()
        {
            if (ValuesChanged != null) ValuesChanged(this);
        }
    }
}
