// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.Text.RegularExpressions;
using UnityEngine;

namespace Hfx.Haptics
{
    /// <summary>
    /// Finds the transforms of a clip's bones by names. An avatar of the clip's own rig is matched name by name, any
    /// other by the human bones that its names stand for: VRM, Unity, Mixamo (any prefix and separator), Unreal,
    /// Rigify (DEF-), Biped, VRoid, Character Creator, SMPL and plain left and right names; then by the humanoid avatar.
    /// </summary>
    public static class BoneNames
    {
        /// <summary>Share of a clip's bones above which an avatar counts as the clip's own rig.</summary>
        const double OwnRig = 0.6;
        static readonly Regex Prefix = new Regex(
            @"^(mixamorig\d*|j_bip|(?:valvebiped[._])?bip\d*|cc_base|def)(?=[\s_\-.:]|(?-i:[A-Z]))", RegexOptions.IgnoreCase);
        static readonly Regex Tokens = new Regex(@"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+");
        static readonly Dictionary<string, string> Fallbacks = new Dictionary<string, string>
        {
            { "upperChest", "chest" }, { "chest", "spine" }, { "jaw", "head" }, { "leftEye", "head" }, { "rightEye", "head" },
        };
        static readonly Dictionary<string, string> Centre = BySpelling(new[]
        {
            "hips: hips hip pelvis",
            "spine: spine chest upperchest lowerchest chestupper chestlower abdomen abdomenupper abdomenlower torso waist upperspine lowerspine back",
            "neck: neck necklower neckupper necktwist lowerneck upperneck", "head: head", "jaw: jaw lowerjaw",
        });
        static readonly Dictionary<string, string> Sided = BySpelling(new[]
        {
            "Collar: clavicle clav collar collarbone", "Shoulder: shoulder shldr",
            "UpperArm: upperarm uparm uarm armupper shldrbend upperarmbend shoulderbend armstretch humerus", "Arm: arm",
            "LowerArm: lowerarm loarm lowarm larm forearm armlower forearmbend forearmstretch elbow", "Hand: hand wrist",
            "UpperLeg: upperleg upleg uleg thigh legupper thighbend thighstretch femur", "Leg: leg", "Hip: hip hips",
            "LowerLeg: lowerleg loleg lowleg lleg leglower shin calf knee legstretch", "Foot: foot ankle",
            "Toes: toe toes toebase ball", "Eye: eye",
        });
        /// <summary>Names of a human bone in the order in which they count.</summary>
        static readonly string[] Limbs =
        {
            "Shoulder: Collar Shoulder", "UpperArm: UpperArm Arm", "LowerArm: LowerArm", "Hand: Hand", "UpperLeg: UpperLeg",
            "LowerLeg: LowerLeg Leg", "Foot: Foot", "Toes: Toes", "Eye: Eye",
        };
        static readonly string[] Digits = { "Thumb", "Index", "Middle", "Ring", "Little" };
        static readonly string[] Fingers = { "Proximal", "Intermediate", "Distal" }, Thumb = { "Metacarpal", "Proximal", "Distal" };
        static readonly Dictionary<string, int> DigitWords = new Dictionary<string, int>
        {
            { "thumb", 0 }, { "index", 1 }, { "pointer", 1 }, { "middle", 2 }, { "mid", 2 }, { "ring", 3 }, { "pinky", 4 }, { "little", 4 },
        };
        static readonly Dictionary<string, int> Phalanges = new Dictionary<string, int>
        {
            { "metacarpal", 0 }, { "proximal", 1 }, { "intermediate", 2 }, { "medial", 2 }, { "distal", 3 },
        };
        static readonly HashSet<string> Fillers = new HashSet<string> { "bone", "bn", "joint", "jnt", "j", "b", "bind", "skin", "rig" };
        static readonly Dictionary<string, string> Sides = new Dictionary<string, string>
        {
            { "l", "left" }, { "left", "left" }, { "r", "right" }, { "right", "right" },
        };

        struct Candidate
        {
            public int Numbers, Depth, Index; // of the name; below the root; among the transforms
            public Transform Transform;
        }

        /// <summary>The transform of each bone, null where there is none.</summary>
        /// <param name="transforms">Parents before children.</param>
        /// <param name="animator">Of a humanoid avatar, for bones without a known name; may be null.</param>
        public static Transform[] Find(Bone[] bones, Transform[] transforms, Animator animator)
        {
            Dictionary<string, Transform> byName = new Dictionary<string, Transform>();
            foreach (Transform each in transforms)
                if (!byName.ContainsKey(Plain(each.name))) byName.Add(Plain(each.name), each);
            Dictionary<string, Transform> byHuman = HumanBones(transforms);
            int named = 0;
            foreach (Bone bone in bones) named += byName.ContainsKey(Plain(bone.Name)) ? 1 : 0;
            bool isOwn = named > OwnRig * bones.Length;
            Transform[] found = new Transform[bones.Length];
            for (int k = 0; k < bones.Length; k++)
            {
                Transform own;
                byName.TryGetValue(Plain(bones[k].Name), out own);
                HumanBodyBones body;
                string human = bones[k].Human.Length == 0 || (isOwn && own != null) ? null : bones[k].Human;
                while (found[k] == null && human != null)
                {
                    byHuman.TryGetValue(human, out found[k]);
                    if (found[k] == null && animator != null && animator.isHuman && TryHuman(human, out body))
                        found[k] = animator.GetBoneTransform(body);
                    Fallbacks.TryGetValue(human, out human);
                }
                if (found[k] == null) found[k] = own;
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

        /// <summary>VRM's human bones (leftUpperArm) that the names of transforms stand for.</summary>
        public static Dictionary<string, Transform> HumanBones(Transform[] transforms)
        {
            Dictionary<string, List<Candidate>> candidates = new Dictionary<string, List<Candidate>>();
            for (int k = 0; k < transforms.Length; k++)
            {
                int numbers, depth = 0;
                string slot = Slot(transforms[k].name, out numbers);
                if (slot.Length == 0) continue;
                for (Transform parent = transforms[k].parent; parent != null; parent = parent.parent) depth++;
                if (!candidates.ContainsKey(slot)) candidates.Add(slot, new List<Candidate>());
                candidates[slot].Add(new Candidate { Numbers = numbers, Depth = depth, Index = k, Transform = transforms[k] });
            }
            Dictionary<string, Transform> first = new Dictionary<string, Transform>(), found = new Dictionary<string, Transform>();
            foreach (KeyValuePair<string, List<Candidate>> each in candidates)
            {
                each.Value.Sort(Compare);
                first.Add(each.Key, each.Value[0].Transform);
            }
            FindLimbs("left", first, found);
            FindLimbs("right", first, found);
            List<Candidate> spine;
            candidates.TryGetValue("spine", out spine);
            FindSpine(spine ?? new List<Candidate>(), first, found);
            return found;
        }

        /// <summary>Names with fewer numbers first, then those nearer to the root.</summary>
        static int Compare(Candidate one, Candidate other)
        {
            int by = one.Numbers.CompareTo(other.Numbers);
            if (by == 0) by = one.Depth.CompareTo(other.Depth);
            return by != 0 ? by : one.Index.CompareTo(other.Index);
        }

        static void FindLimbs(string side, Dictionary<string, Transform> first, Dictionary<string, Transform> found)
        {
            bool hasUpperArm = first.ContainsKey(side + "UpperArm"), hasArm = first.ContainsKey(side + "Arm");
            foreach (string limb in Limbs)
            {
                string human = limb.Substring(0, limb.IndexOf(':')), names = limb.Substring(human.Length + 2);
                if (human == "LowerArm" && hasUpperArm) names += " Arm"; // upper arm and arm
                if (human == "UpperArm" && !hasUpperArm && !hasArm) names += " Shoulder"; // collar and shoulder
                if (human == "Shoulder" && !hasUpperArm && !hasArm) names = "Collar";
                if (human == "UpperLeg") names += first.ContainsKey(side + "LowerLeg") ? " Leg Hip" : " Hip"; // leg and knee
                foreach (string name in names.Split(' '))
                    if (!found.ContainsKey(side + human) && first.ContainsKey(side + name)) found.Add(side + human, first[side + name]);
            }
            foreach (string digit in Digits)
                for (int joint = 0; joint < 3; joint++)
                    Take(first, side + digit + (joint + 1), found, side + digit + (digit == "Thumb" ? Thumb : Fingers)[joint]);
            // A thumb in words: metacarpal, proximal, distal, or Unity's proximal, intermediate, distal.
            string[] words = first.ContainsKey(side + "Thumbintermediate") ? Fingers : Thumb;
            for (int joint = 0; joint < 3; joint++)
                Take(first, side + "Thumb" + words[joint].ToLowerInvariant(), found, side + "Thumb" + Thumb[joint]);
        }

        static void FindSpine(List<Candidate> chain, Dictionary<string, Transform> first, Dictionary<string, Transform> found)
        {
            chain.Sort((one, other) => one.Depth != other.Depth ? one.Depth.CompareTo(other.Depth) : one.Index.CompareTo(other.Index));
            foreach (string human in new[] { "hips", "neck", "head", "jaw" }) Take(first, human, found, human);
            if (!found.ContainsKey("hips") && chain.Count > 1) // Rigify: all of the spine, from hips to head
            {
                found["hips"] = chain[0].Transform;
                chain.RemoveAt(0);
            }
            if (!found.ContainsKey("head") && chain.Count > 3)
            {
                found["head"] = chain[chain.Count - 1].Transform;
                chain.RemoveAt(chain.Count - 1);
                int neck = Math.Min(3, chain.Count - 1);
                if (!found.ContainsKey("neck"))
                {
                    found["neck"] = chain[neck].Transform;
                    chain.RemoveRange(neck, chain.Count - neck);
                }
            }
            if (chain.Count > 0) found["spine"] = chain[0].Transform;
            if (chain.Count > 1) found["chest"] = chain[chain.Count / 2].Transform;
            if (chain.Count > 2) found["upperChest"] = chain[chain.Count - 1].Transform;
        }

        static void Take(Dictionary<string, Transform> from, string name, Dictionary<string, Transform> to, string human)
        {
            if (from.ContainsKey(name)) to[human] = from[name];
        }

        /// <summary>Part of the body that a name stands for, behind left or right; empty: none. Twists have more numbers.</summary>
        static string Slot(string name, out int count)
        {
            name = name.Substring(name.LastIndexOfAny(new[] { ':', '|' }) + 1);
            string side = "", stem, limb;
            List<string> words = new List<string>(), numbers = new List<string>();
            foreach (Match token in Tokens.Matches(Prefix.Replace(name, "")))
            {
                string word = token.Value.ToLowerInvariant();
                if (char.IsDigit(word[0])) numbers.Add(word);
                else if (side.Length == 0 && Sides.ContainsKey(word)) side = Sides[word];
                else if (!Fillers.Contains(word)) words.Add(word);
            }
            count = numbers.Count;
            if (words.Count > 1 && (words[0] == "c" || words[0] == "m")) words.RemoveAt(0);
            stem = string.Concat(words.ToArray());
            foreach (string mark in new[] { "left", "right", "l", "r" }) // joined to the word: handl, leftarm
                for (int end = 0; end < 2 && side.Length == 0; end++)
                {
                    if (end == 0 ? !stem.StartsWith(mark, StringComparison.Ordinal) : !stem.EndsWith(mark, StringComparison.Ordinal)) continue;
                    string rest = end == 0 ? stem.Substring(mark.Length) : stem.Substring(0, stem.Length - mark.Length);
                    if (!Sided.ContainsKey(rest) && !DigitWords.ContainsKey(rest)) continue;
                    side = Sides[mark];
                    stem = rest;
                    words = new List<string> { rest };
                }
            string finger = Finger(words, numbers);
            if (finger.Length > 0) return side.Length > 0 ? side + finger : "";
            if (side.Length > 0) return Sided.TryGetValue(stem, out limb) ? side + limb : "";
            if (!Centre.TryGetValue(stem, out limb)) return "";
            if (limb == "spine") count = 0;
            return limb;
        }

        /// <summary>A digit and its joint: a number from 1 ("Index1"), of a thumb also a word ("Thumbdistal").</summary>
        static string Finger(List<string> words, List<string> numbers)
        {
            int digit = -1, joint = numbers.Count > 0 ? Number(numbers[numbers.Count - 1]) : 1;
            string phalanx = "";
            bool isFinger = false;
            foreach (string word in words)
            {
                if (DigitWords.ContainsKey(word) && digit < 0) digit = DigitWords[word];
                else if (Phalanges.ContainsKey(word)) phalanx = word;
                else if (word == "finger" || word == "fingers") isFinger = true;
                else if (word != "hand" && word != "f") return "";
            }
            if (digit < 0)
            {
                if (!isFinger || numbers.Count == 0) return "";
                digit = Number(numbers[0]) - 1; // finger1-1
                if (numbers.Count == 1) // Biped's Finger0, Finger01, Finger02: a thumb
                {
                    digit = numbers[0][0] - '0';
                    joint = Number(numbers[0].Substring(1)) + 1;
                }
                if (digit < 0 || digit > 4) return "";
            }
            if (phalanx.Length > 0 && digit == 0) return "Thumb" + (phalanx == "medial" ? "intermediate" : phalanx);
            if (phalanx.Length > 0) joint = Phalanges[phalanx];
            return joint >= 1 && joint <= 3 ? Digits[digit] + joint : "";
        }

        static int Number(string digits)
        {
            int number;
            return int.TryParse(digits, out number) ? number : 0;
        }

        /// <summary>A name without namespace, separators and upper case.</summary>
        static string Plain(string name)
        {
            return Regex.Replace(name.Substring(name.LastIndexOf(':') + 1), @"[ ._\-/]", "").ToLowerInvariant();
        }

        static Dictionary<string, string> BySpelling(string[] slots)
        {
            Dictionary<string, string> found = new Dictionary<string, string>();
            foreach (string slot in slots)
            {
                string name = slot.Substring(0, slot.IndexOf(':'));
                foreach (string spelling in slot.Substring(name.Length + 2).Split(' ')) found.Add(spelling, name);
            }
            return found;
        }
    }
}
