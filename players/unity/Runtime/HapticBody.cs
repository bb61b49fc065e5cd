// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using UnityEngine;

namespace Hfx.Haptics
{
    /// <summary>
    /// Lets an avatar feel <see cref="HapticVolume"/> components and painted areas of a clip, on its
    /// own moves. It stands on the root of the avatar whose rest pose is that of the body in the clip. The pose of
    /// each transform when this component first finds it counts as its rest pose: that before the animator moves
    /// anything, or see <see cref="TakeRestPose"/>. Everything may be set and changed at any time. All is neutral while
    /// the game is paused or has lost its focus. Needs the compiled core.
    /// </summary>
    [AddComponentMenu("Haptics/Haptic Body")]
    [DefaultExecutionOrder(HapticBody.LateOrder)]
    public sealed class HapticBody : MonoBehaviour
    {
        /// <summary>
        /// Order of <c>LateUpdate</c>. Animators and Animation Rigging have moved the bones before any of them; scripts
        /// that move bones in <c>LateUpdate</c> (inverse kinematics, look-at) have to have a lower order.
        /// </summary>
        public const int LateOrder = 30000;

        [SerializeField] HapticClipAsset clip;
        /// <summary>
        /// The clip whose volumes and painted areas are felt, on the body of the other clip and with its devices: a
        /// library for all avatars. Empty: those of the clip itself.
        /// </summary>
        [SerializeField] HapticClipAsset effects;
        /// <summary>For bones that are found by no name, of a humanoid avatar; empty: the first in this object.</summary>
        [SerializeField] Animator animator;
        /// <summary>The body of the clip; empty: its first.</summary>
        [SerializeField] string body = "";

        struct Placed
        {
            public HapticVolume Volume;
            public string Effect;
            public int Number; // in the core; -1: the clip has no such volume
        }

        static readonly List<HapticBody> All = new List<HapticBody>();
        static readonly string[] NoBones = new string[0];
        const int Named = 12; // bones in a message

        readonly List<Placed> placed = new List<Placed>(); // in the order of HapticVolume.All
        readonly Dictionary<string, float> triggers = new Dictionary<string, float>();
        readonly Dictionary<string, Vector3> places = new Dictionary<string, Vector3>(); // degrees, metres, heights
        readonly Dictionary<Transform, Matrix4x4> rest = new Dictionary<Transform, Matrix4x4>(); // to the root
        LiveBody core;
        Transform[] bones; // for each bone of the clip; null: as its parent
        Matrix4x4[] fromRest; // the clip's rest space to the bone, at rest
        float[] matrices, matrix, values;
        string[] missing = NoBones;
        bool isStale; // opens anew: settings have changed, or time has stood still
        bool isUnfocused, isPaused;

        /// <summary>Each frame, and once more when it falls silent: all columns, in their units.</summary>
        public event Action<HapticBody> ValuesChanged;

        /// <summary>The clip's file; the triggers stay.</summary>
        public HapticClipAsset Asset
        {
            get { return clip; }
            set
            {
                Close();
                clip = value;
            }
        }

        /// <summary>The file of a clip whose effects are felt in place of the clip's own; null: none. The triggers stay.</summary>
        public HapticClipAsset EffectAsset
        {
            get { return effects; }
            set
            {
                effects = value;
                isStale = true;
            }
        }

        /// <summary>For bones that are found by no name, of a humanoid avatar; null: the first in this object.</summary>
        public Animator Animator
        {
            get { return animator; }
            set
            {
                animator = value;
                isStale = true;
            }
        }

        /// <summary>Name of the body in the clip; empty: its first.</summary>
        public string BodyName
        {
            get { return body; }
            set
            {
                body = value ?? "";
                isStale = true;
            }
        }

        public HapticClip Clip { get { return clip != null ? clip.Clip : null; } }
        /// <summary>The clip with the effects that are felt.</summary>
        public HapticClip EffectClip { get { return effects != null ? effects.Clip : Clip; } }
        /// <summary>One value for each column; null before the first frame with a clip.</summary>
        public float[] Values { get { return values; } }
        /// <summary>The core; null before the first frame, and where it or the clip is missing.</summary>
        public LiveBody Core { get { return core; } }
        /// <summary>Bones of the clip that carry skin and were not found; they move with their parents.</summary>
        public string[] MissingBones { get { return missing; } }

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

        /// <summary>
        /// Turns a painted area on at a factor of 0 (off) to 1 of its level in the clip; false: the clip has none of
        /// this name. It stays when the component is disabled, or gets another clip.
        /// </summary>
        public bool Trigger(string effect, float factor)
        {
            bool found = false;
            triggers[effect] = factor;
            HapticClip of = EffectClip;
            for (int k = 0; of != null && k < of.Effects.Length; k++)
            {
                if (!of.Effects[k].IsPainted || of.Effects[k].Name != effect) continue;
                found = true;
                if (core != null && !isStale) core.Trigger(k, factor);
            }
            return found;
        }

        /// <summary>
        /// Turns a painted area about the body's axis (degrees to the left, seen from above counterclockwise), raises it
        /// by metres, and multiplies heights about its own middle; 0, 0, 1: as made. False: the clip has none of this
        /// name. It stays as after <see cref="Trigger"/>. Takes as long as some frames. Volumes are objects of their own.
        /// </summary>
        public bool Place(string effect, float turnDegrees, float raise = 0.0f, float stretch = 1.0f)
        {
            bool found = false;
            HapticClip of = EffectClip;
            places[effect] = new Vector3(turnDegrees, raise, stretch);
            for (int k = 0; of != null && k < of.Effects.Length; k++)
            {
                if (!of.Effects[k].IsPainted || of.Effects[k].Name != effect) continue;
                found = true;
                if (core != null && !isStale) core.Place(k, turnDegrees, raise, stretch);
            }
            return found;
        }

        /// <summary>Takes the present pose as the rest pose: for an avatar whose skeleton moved before it came here.</summary>
        public void TakeRestPose()
        {
            rest.Clear();
            KeepRestPose();
            isStale = true;
        }

        /// <summary>Number in the core of a volume that is enabled; -1: this body does not feel it.</summary>
        public int NumberOf(HapticVolume volume)
        {
            for (int k = 0; k < placed.Count; k++)
                if (ReferenceEquals(placed[k].Volume, volume)) return placed[k].Number;
            return -1;
        }

        void Awake() { KeepRestPose(); }

        void OnEnable()
        {
            All.Add(this);
            isUnfocused = !Application.isFocused;
            isPaused = false;
            isStale = true;
        }

        void OnDisable()
        {
            All.Remove(this);
            Close();
        }

        void OnDestroy() { Close(); }

        /// <summary>A skeleton may have come.</summary>
        void OnTransformChildrenChanged() { isStale |= core == null || missing.Length > 0; }

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
            if (isUnfocused || isPaused) Silence();
        }

        /// <summary>Neutral values; what moves until the next frame is no touch.</summary>
        void Silence()
        {
            isStale = true;
            if (core == null) return;
            for (int k = 0; k < values.Length; k++) values[k] = (float)core.Clip.Columns[k].Neutral;
            Tell();
        }

        void Close()
        {
            Silence();
            if (core != null) core.Dispose();
            core = null;
            values = null;
            placed.Clear();
        }

        void LateUpdate()
        {
            if (isUnfocused || isPaused) return;
            if (Time.timeScale == 0.0f)
            {
                Silence();
                return;
            }
            if (isStale) Reopen();
            if (core == null) return;
            Pose();
            Place();
            core.Evaluate(Time.deltaTime, values);
            Tell();
        }

        void Reopen()
        {
            Close();
            isStale = false;
            string fault = Open();
            if (fault.Length == 0) return;
            Debug.LogError("The haptic body feels nothing: " + fault, this);
            if (core != null) core.Dispose();
            core = null;
        }

        string Open()
        {
            if (clip == null) return "choose a clip.";
            int number = -1;
            Body[] bodies = clip.Clip.Bodies;
            for (int k = bodies.Length - 1; k >= 0; k--)
                if (body.Length == 0 || bodies[k].Name == body) number = k;
            if (bodies.Length == 0) return "the clip has no spatial part.";
            if (number < 0)
                return "the clip has no body '" + body + "', but: " + string.Join(", ", Array.ConvertAll(bodies, of => of.Name)) + ".";
            try
            {
                core = new LiveBody(clip.Clip, number, effects != null ? effects.Clip : null);
            }
            catch (DllNotFoundException)
            {
                return "the compiled core is not there (build it with players/native/build.py).";
            }
            catch (EntryPointNotFoundException)
            {
                return "the compiled core is older than this package (build it again with players/native/build.py).";
            }
            catch (FormatException fault)
            {
                return fault.Message;
            }
            values = new float[clip.Clip.Columns.Length];
            matrix = new float[12];
            // Each volume is one of its own; those of the clip itself are off.
            Effect[] all = core.EffectClip.Effects;
            for (int k = 0; k < all.Length; k++)
            {
                float factor = 0.0f;
                Vector3 place;
                if (all[k].IsPainted) triggers.TryGetValue(all[k].Name, out factor);
                core.Trigger(k, factor);
                if (places.TryGetValue(all[k].Name, out place)) core.Place(k, place.x, place.y, place.z);
            }
            WarnOfModels(all);
            return FindBones() ? "" : "no bone of the avatar has a known name. Known are those of the clip, VRM, Mixamo, Unreal and Rigify.";
        }

        /// <summary>Names effects of a library that the body of the clip has no skin for.</summary>
        void WarnOfModels(Effect[] all)
        {
            if (core.EffectClip == core.Clip) return;
            List<string> lost = new List<string>();
            for (int k = 0; k < all.Length; k++)
                if (core.GetWeights(k).Length == 0) lost.Add(all[k].Name);
            if (lost.Count == 0) return;
            Debug.LogWarning("The haptic body does not feel " + string.Join(", ", lost.ToArray()) + ": the scene of its clip has no effect of that modality.", this);
        }

        void KeepRestPose()
        {
            Matrix4x4 toRoot = transform.worldToLocalMatrix;
            foreach (Transform each in GetComponentsInChildren<Transform>(true))
                if (!rest.ContainsKey(each)) rest.Add(each, toRoot * each.localToWorldMatrix);
        }

        bool FindBones()
        {
            Bone[] wanted = core.Body.Bones;
            KeepRestPose(); // of transforms that came later
            Animator humanoid = animator != null ? animator : GetComponentInChildren<Animator>();
            bones = BoneNames.Find(wanted, GetComponentsInChildren<Transform>(true), humanoid);
            fromRest = new Matrix4x4[wanted.Length];
            matrices = new float[12 * wanted.Length];
            List<string> lost = new List<string>();
            bool isAny = false;
            for (int k = 0; k < wanted.Length; k++)
            {
                if (bones[k] == null && wanted[k].HasSkin) lost.Add(wanted[k].Name);
                if (bones[k] == null || !rest.ContainsKey(bones[k])) continue;
                fromRest[k] = rest[bones[k]].inverse * ToUnity;
                isAny = true;
            }
            missing = lost.ToArray();
            if (isAny && lost.Count > 0)
            {
                string names = string.Join(", ", missing, 0, Math.Min(missing.Length, Named));
                if (missing.Length > Named) names += " and " + (missing.Length - Named) + " more";
                Debug.LogWarning("The avatar has no transform for these bones of the clip, whose skin moves with their parents: " + names + ".", this);
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

        /// <summary>
        /// Moves the volumes of this body as the enabled components have moved. New components stand at the end of
        /// <see cref="HapticVolume.All"/>, so that a volume that is not the next one there has been disabled.
        /// </summary>
        void Place()
        {
            List<HapticVolume> all = HapticVolume.All;
            Matrix4x4 toUnity = ToUnity;
            for (int k = 0; k < all.Count; k++)
            {
                while (k < placed.Count && !ReferenceEquals(placed[k].Volume, all[k])) Remove(k);
                if (k == placed.Count) placed.Add(Added(all[k]));
                if (placed[k].Effect != all[k].Effect)
                {
                    if (placed[k].Number >= 0) core.RemoveVolume(placed[k].Number);
                    placed[k] = Added(all[k]);
                }
                int number = placed[k].Number;
                if (number < 0) continue;
                Write(all[k].transform.localToWorldMatrix * toUnity, matrix, 0);
                core.SetVolume(number, matrix);
                core.Trigger(number, all[k].Level);
            }
            while (placed.Count > all.Count) Remove(placed.Count - 1);
        }

        void Remove(int index)
        {
            if (placed[index].Number >= 0) core.RemoveVolume(placed[index].Number);
            placed.RemoveAt(index);
        }

        Placed Added(HapticVolume volume)
        {
            int effect = VolumeNamed(core.EffectClip, volume.Effect);
            bool isKnown = effect >= 0;
            for (int k = 0; k < All.Count && !isKnown; k++) isKnown = VolumeNamed(All[k].EffectClip, volume.Effect) >= 0;
            if (!isKnown)
                Debug.LogWarning("No haptic body has a clip with a volume named '" + volume.Effect + "'.", volume);
            return new Placed { Volume = volume, Effect = volume.Effect, Number = effect < 0 ? -1 : core.AddVolume(effect) };
        }

        static int VolumeNamed(HapticClip of, string name)
        {
            for (int k = 0; of != null && k < of.Effects.Length; k++)
                if (!of.Effects[k].IsPainted && of.Effects[k].Name == name) return k;
            return -1;
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
