// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.Text.RegularExpressions;
using UnityEngine;

namespace Hfx.Haptics
{
    /// <summary>
    /// Finds the transforms of a clip's bones by names: those of the scene, VRM, Unity, Mixamo, Unreal, Rigify, VRoid,
    /// Biped and Character Creator, with any namespace or shared prefix, separator, letter case and mark of the side;
    /// then by the humanoid avatar.
    /// </summary>
    public static class BoneNames
    {
        static readonly Regex Prefix = new Regex(
            @"^(mixamorig\d*|j_bip|(valvebiped\.)?bip\d*|cc_base|def)(?=[\s_\-.:A-Z])", RegexOptions.IgnoreCase);
        static readonly Regex Words = new Regex(@"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+");
        /// <summary>Share of the transforms with the same first word above which that word is a prefix.</summary>
        const double Shared = 0.6;

        /// <summary>Further names of VRM's joints, without side.</summary>
        static readonly Dictionary<string, string[]> Others = new Dictionary<string, string[]>
        {
            { "hips", new[] { "hip", "pelvis" } }, { "spine", new[] { "waist" } }, { "chest", new[] { "spine1" } },
            { "upperchest", new[] { "spine2" } }, { "shoulder", new[] { "clavicle", "collar" } },
            { "upperarm", new[] { "arm" } }, { "lowerarm", new[] { "forearm" } }, { "hand", new[] { "wrist" } },
            { "upperleg", new[] { "thigh" } }, { "lowerleg", new[] { "calf", "shin" } }, { "foot", new[] { "ankle" } },
            { "toes", new[] { "toe", "toebase", "toe0", "ball" } },
        };

        /// <summary>VRM's joints on Rigify's chain DEF-spine, DEF-spine.001, ..., which begins at the hips.</summary>
        static readonly Dictionary<string, string> RigifySpine = new Dictionary<string, string>
        {
            { "hips", "spine" }, { "spine", "spine001" }, { "chest", "spine002" }, { "upperchest", "spine003" },
            { "neck", "spine004" }, { "head", "spine006" },
        };

        /// <summary>The transform of each bone, null where none has a known name.</summary>
        /// <param name="animator">Of a humanoid avatar, for bones without a known name; may be null.</param>
        public static Transform[] Find(Bone[] bones, Transform[] transforms, Animator animator)
        {
            Dictionary<string, Transform> byKey = ByKey(transforms);
            bool isRigify = byKey.ContainsKey("spine001") && !byKey.ContainsKey("hips") && !byKey.ContainsKey("pelvis");
            List<string[][]> namings = new List<string[][]>();
            foreach (Func<Bone, string[]> naming in new Func<Bone, string[]>[] { OfScene, OfHuman, OfMixamo, OfUnreal })
                namings.Add(Array.ConvertAll(bones, bone => naming(bone)));
            // A "root" can be the hips of one naming and the floor of another: the naming that fits most bones goes first.
            int[] fits = namings.ConvertAll(naming => Fitting(naming, byKey)).ToArray();
            string[][][] order = namings.ToArray();
            Array.Sort(Array.ConvertAll(fits, (fit) => -fit), order);
            namings = new List<string[][]>(order) { Array.ConvertAll(bones, bone => OfOthers(bone)) };
            if (isRigify) namings.Insert(0, Array.ConvertAll(bones, bone => OfRigify(bone)));
            Transform[] found = new Transform[bones.Length];
            for (int k = 0; k < bones.Length; k++)
            {
                foreach (string[][] naming in namings)
                    foreach (string key in naming[k])
                        if (found[k] == null && key.Length > 0) byKey.TryGetValue(key, out found[k]);
                HumanBodyBones human;
                if (found[k] == null && animator != null && animator.isHuman && TryHuman(bones[k].Human, out human))
                    found[k] = animator.GetBoneTransform(human);
            }
            return found;
        }

        /// <summary>Unity's name of VRM's human bone: a capital letter, and a thumb without metacarpal.</summary>
        public static bool TryHuman(string human, out HumanBodyBones found)
        {
            found = HumanBodyBones.LastBone;
            if (human.Length == 0) return false;
            string name = char.ToUpperInvariant(human[0]) + human.Substring(1);
            if (name.EndsWith("ThumbProximal")) name = name.Replace("Proximal", "Intermediate");
            if (name.EndsWith("ThumbMetacarpal")) name = name.Replace("Metacarpal", "Proximal");
            if (!Enum.IsDefined(typeof(HumanBodyBones), name)) return false;
            found = (HumanBodyBones)Enum.Parse(typeof(HumanBodyBones), name);
            return true;
        }

        /// <summary>
        /// Lower-case words and numbers of a name without namespace, known prefix and separators, behind "l " or "r "
        /// for a side: "l upperarm" of "DEF-upper_arm.L" and "LeftUpperArm".
        /// </summary>
        public static string Key(string name) { return Joined(WordsOf(name), 0); }

        static string[] OfScene(Bone bone) { return new[] { Key(bone.Name) }; }

        static string[] OfHuman(Bone bone) { return new[] { Key(bone.Human) }; }

        static string[] OfMixamo(Bone bone) { return new[] { Key(bone.Mixamo) }; }

        static string[] OfUnreal(Bone bone) { return new[] { Key(bone.Unreal) }; }

        static string[] OfRigify(Bone bone)
        {
            string key;
            return RigifySpine.TryGetValue(Key(bone.Human), out key) ? new[] { key } : new string[0];
        }

        /// <summary>Further names of the joint; of fingers Mixamo's without "Hand", and Rigify's with an F.</summary>
        static string[] OfOthers(Bone bone)
        {
            string human = Key(bone.Human), side = human.Length > 1 && human[1] == ' ' ? human.Substring(0, 2) : "";
            string[] others;
            if (Others.TryGetValue(human.Substring(side.Length), out others))
                return Array.ConvertAll(others, other => side + other);
            if (side.Length == 0) return new string[0];
            return new[] { Key(bone.Mixamo).Replace("hand", ""), side + "f" + Key(bone.Unreal).Substring(side.Length) };
        }

        /// <summary>First transform of each key; of a rig with Blender's deforming bones (DEF-) only these.</summary>
        static Dictionary<string, Transform> ByKey(Transform[] transforms)
        {
            Dictionary<string, Transform> byKey = new Dictionary<string, Transform>();
            Dictionary<string, int> counts = new Dictionary<string, int>();
            List<string>[] words = new List<string>[transforms.Length];
            bool isDeforming = Array.Exists(transforms, each => IsDeforming(each.name));
            int most = 3;
            string prefix = null;
            for (int k = 0; k < transforms.Length; k++)
            {
                words[k] = WordsOf(transforms[k].name);
                if (words[k].Count < 2) continue;
                int count;
                counts.TryGetValue(words[k][0], out count);
                counts[words[k][0]] = ++count;
                if (count <= most) continue;
                most = count;
                prefix = words[k][0];
            }
            if (most < Shared * transforms.Length) prefix = null;
            for (int k = 0; k < transforms.Length; k++)
            {
                if (isDeforming && !IsDeforming(transforms[k].name)) continue;
                bool hasPrefix = prefix != null && words[k].Count > 1 && words[k][0] == prefix;
                string key = Joined(words[k], hasPrefix ? 1 : 0);
                if (key.Length > 0 && !byKey.ContainsKey(key)) byKey.Add(key, transforms[k]);
            }
            return byKey;
        }

        static bool IsDeforming(string name) { return Regex.IsMatch(name, @"^(DEF|def)[\s_\-.]"); }

        static List<string> WordsOf(string name)
        {
            name = name.Substring(name.LastIndexOfAny(new[] { ':', '|' }) + 1);
            List<string> words = new List<string>();
            foreach (Match word in Words.Matches(Prefix.Replace(name, ""))) words.Add(word.Value.ToLowerInvariant());
            return words;
        }

        static string Joined(List<string> words, int first)
        {
            string side = "", rest = "";
            for (int k = first; k < words.Count; k++)
            {
                if (words[k] == "left" || words[k] == "l") side = "l ";
                else if (words[k] == "right" || words[k] == "r") side = "r ";
                else if (words[k] != "c") rest += words[k]; // VRoid's centre
            }
            return rest.Length > 0 ? side + rest : "";
        }

        static int Fitting(string[][] naming, Dictionary<string, Transform> byKey)
        {
            int count = 0;
            foreach (string[] keys in naming)
                if (keys[0].Length > 0 && byKey.ContainsKey(keys[0])) count++;
            return count;
        }
    }
}
