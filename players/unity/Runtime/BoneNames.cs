// SPDX-License-Identifier: MIT
using System;
using UnityEngine;

namespace Hfx.Haptics
{
    /// <summary>Finds the transform of a clip's bone: by the names of common rigs, then by the humanoid avatar.</summary>
    static class BoneNames
    {
        static readonly string[] Prefixes = { "", "mixamorig:", "mixamorig_", "mixamorig" };

        public static Transform Find(Bone bone, Transform[] transforms, Animator animator)
        {
            Transform found = Named(bone.Name, transforms);
            for (int k = 0; k < Prefixes.Length && found == null && bone.Mixamo.Length > 0; k++)
                found = Named(Prefixes[k] + bone.Mixamo, transforms);
            if (found == null) found = Named(bone.Unreal, transforms);
            HumanBodyBones human;
            if (found != null || animator == null || !animator.isHuman || !TryHuman(bone.Human, out human)) return found;
            return animator.GetBoneTransform(human);
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

        static Transform Named(string name, Transform[] transforms)
        {
            for (int k = 0; k < transforms.Length && name.Length > 0; k++)
                if (transforms[k].name == name) return transforms[k];
            return null;
        }
    }
}
